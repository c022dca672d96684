"""A run read: complete, running or cut short."""
