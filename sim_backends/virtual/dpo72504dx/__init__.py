"""The virtual oscilloscope DPO72504DX."""
