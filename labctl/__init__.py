"""labctl: runs a photonic machine-vision bench, real or simulated, from images in to accuracy out."""

from importlib.metadata import version

__version__ = version("photonic-labctl")
