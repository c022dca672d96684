"""What can be told of a run, and asked of it, while it goes on."""
