"""Measuring a bench before its first run."""
