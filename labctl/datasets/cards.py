"""Data cards: what is known about each data set, read from the TOML files beside the bundled samples.

In a checkout the cards lie in `data/`; in an installed package they lie in `labctl/bundled/`.
"""

import tomllib
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from labctl.datasets.errors import DatasetError

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class DataFile(BaseModel):
    """One file of a data set.

    Attributes:
        name: File name inside the data set's folder.
        role: What it holds: idx images, idx labels, or records of the bundled sample.
        sha256: Digest of the content after decompression; this is what must match when data is read, because the same
            idx file may have been compressed again by another program.
        sha256_gz: Digest of the gzip file as its publisher serves it; None for files that are not downloaded.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    role: Literal["images", "labels", "records"]
    sha256: Sha256
    sha256_gz: Sha256 | None = None


class Card(BaseModel):
    """What a user must know about a data set before quoting a figure obtained with it.

    Attributes:
        name: Name used in commands and settings.
        title: Name for people.
        folder: Folder that holds the files, below a data directory.
        source: Address the files are downloaded from (ending in a slash), or where the sample was taken from.
        licence: Licence of the data, which is not the licence of this program.
        attribution: Authors to be named with the data.
        shape: Images, rows, columns.
        classes: Name of each class; the position is the label.
        binarisation: Rule that made the pixels binary; "none" for grey levels 0..255.
        bundled: True if the files come with the program.
        traps: Known properties that spoil a careless evaluation.
        files: The files, training part before test part; records: one file a class, in the order of the classes.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    title: str
    folder: str
    source: str
    licence: str
    attribution: str
    shape: tuple[int, int, int]
    classes: tuple[str, ...]
    binarisation: str = "none"
    bundled: bool = False
    traps: tuple[str, ...] = ()
    files: tuple[DataFile, ...]


def bundled_directory() -> Path:
    """Folder of the cards and bundled samples: `labctl/bundled` when installed, `data` in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "bundled"
    return installed if installed.is_dir() else package.parent / "data"


@cache
def catalogue() -> tuple[Card, ...]:
    """All data cards, sorted by name."""
    files = bundled_directory().glob("*.toml")
    cards = (Card.model_validate(tomllib.loads(file.read_text(encoding="utf-8"))) for file in files)
    return tuple(sorted(cards, key=lambda card: card.name))


def card(name: str) -> Card:
    """The card of one data set.

    Raises:
        DatasetError: There is no such data set.
    """
    for candidate in catalogue():
        if candidate.name == name:
            return candidate
    known = ", ".join(candidate.name for candidate in catalogue())
    raise DatasetError(f"no data set is called '{name}': choose one of {known}")
