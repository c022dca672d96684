"""The virtual optical switch."""
