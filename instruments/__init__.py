"""Instruments of a photonic machine-vision bench: the interfaces, the drivers behind them, and the bench itself."""
