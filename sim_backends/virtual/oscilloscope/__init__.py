"""What oscilloscopes of one maker have in common: inputs, triggers, records, and how waveforms leave them."""
