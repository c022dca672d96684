"""What the files of a run hold, byte by byte."""
