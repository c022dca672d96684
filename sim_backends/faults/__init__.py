"""Faults: a simulated bench one of whose instruments fails at a chosen message, on the wire or in the world."""
