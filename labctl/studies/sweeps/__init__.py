"""Sweeps: one protocol over settings of itself and of the bench, each point a run like any other."""
