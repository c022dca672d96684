"""A run as it is given away: its files, a list of their checksums, and who measured what by which rights."""

from labctl.runs.publication.declaration import Declaration, Person, declared
from labctl.runs.publication.folder import FORMATS, publish

__all__ = ["FORMATS", "Declaration", "Person", "declared", "publish"]
