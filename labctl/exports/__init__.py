"""Runs in the formats of other programs. Each is written by a module of its own, block after block."""

from labctl.exports.content import Content, Progress, Representation
from labctl.exports.writing import FORMATS, write

__all__ = ["FORMATS", "Content", "Progress", "Representation", "write"]
