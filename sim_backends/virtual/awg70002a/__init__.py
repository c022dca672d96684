"""The virtual arbitrary waveform generator AWG70002A."""
