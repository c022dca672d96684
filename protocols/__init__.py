"""Acquisition sequences on the abstract instruments: what is asked of a bench, in the order a person would do it."""
