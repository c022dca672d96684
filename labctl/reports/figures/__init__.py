"""Figures: one module a kind, each a function from arrays to a figure, drawn with `labctl.reports.canvas`."""
