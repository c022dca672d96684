"""Recorded conversations, served as instruments."""
