"""Carries a protocol out on an opened bench and stores what it measures."""
