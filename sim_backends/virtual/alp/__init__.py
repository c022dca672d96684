"""The virtual DMD with the calls of the ALP library."""
