"""A run written: nothing that was reported as stored is lost."""
