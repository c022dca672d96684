"""The virtual optical power meter PM100."""
