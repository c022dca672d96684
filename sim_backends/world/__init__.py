"""Where the virtual instruments meet: one light path, one clock, every trigger."""
