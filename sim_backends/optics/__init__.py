"""The light's way from the generator to the digitiser: pure functions, one module an element."""
