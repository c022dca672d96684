"""IEEE 488.2 messages and the command tables of the virtual instruments."""
