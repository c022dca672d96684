"""Runs in the formats of other programs. Each is written by a module of its own, block after block."""

from labctl.runs.export.content import Content, Progress, Representation
from labctl.runs.export.file import FORMATS, write

__all__ = ["FORMATS", "Content", "Progress", "Representation", "write"]
