"""The virtual tunable laser TLG-220."""
