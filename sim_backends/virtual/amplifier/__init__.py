"""The virtual optical amplifier."""
