"""The virtual variable optical attenuator."""
