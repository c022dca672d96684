"""Recordings of what went over the wire: their format, how they are made, and how they are played."""
