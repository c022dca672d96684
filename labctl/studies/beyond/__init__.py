"""Experiments beyond the paper: what each of them does with its runs."""
