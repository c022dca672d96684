"""A run while it goes on: what it reports, who writes it, and how it is controlled."""
