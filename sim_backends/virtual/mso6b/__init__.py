"""The virtual oscilloscope: Tektronix MSO64B, 6 Series B MSO."""
