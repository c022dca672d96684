"""The queue of a bench: runs and sweeps one after the other, which outlive the process that carries them out."""
