"""The virtual tunable laser TSL-570."""
