"""The virtual DMD controller DLPC900."""
