"""labctl: runs a photonic machine-vision bench, real or simulated, from images in to accuracy out."""
