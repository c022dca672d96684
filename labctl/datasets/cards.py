"""Data cards: what is known about each data set, read from the TOML files next to the bundled samples.

In a checkout the cards lie in `data/`; in an installed package they lie in `labctl/bundled/`.
"""

import tomllib
from functools import cache
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from labctl.errors import DatasetError

Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]


class Archive(BaseModel):
    """A zip archive at the source that holds one file of a data set among others.

    Attributes:
        name: File name of the archive; it follows the card's source.
        member: Path of the data file inside.
        sha256: Digest of the archive.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    member: str
    sha256: Sha256


class DataFile(BaseModel):
    """One file of a data set.

    Attributes:
        name: File name inside the data set's folder.
        role: What it holds: idx images, idx labels, records of the bundled sample, a numpy series, or a table of text.
        sha256: Digest of the content after decompression; this is what must match when data is read, because the same
            idx file may have been compressed again by another program. Of a table: of its rows with the fields joined
            by single commas, because copies with blanks and with commas are in circulation.
        sha256_gz: Digest of the gzip file as its publisher serves it; None for files that are not downloaded so.
        archive: The archive to take the file from; None if the source serves the file itself.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    role: Literal["images", "labels", "records", "series", "table"]
    sha256: Sha256
    sha256_gz: Sha256 | None = None
    archive: Archive | None = None


class Card(BaseModel):
    """What a user must know about a data set before quoting a figure obtained with it.

    Attributes:
        name: Name used in commands and settings.
        title: Name for people.
        folder: Folder that holds the files, below a data directory.
        source: Address the files are downloaded from (ending in a slash), or where the sample was taken from.
        licence: Licence of the data, which is not the licence of this program.
        attribution: Authors to be named with the data.
        kind: Whether it is loaded with `load` or with `load_sequences`.
        shape: Images, rows, columns; or sequences, symbols.
        classes: Name of each class; the position is the label. Empty for a series to be predicted.
        binarisation: Rule that made the pixels binary; "none" for grey levels 0..255.
        bundled: True if the files come with the program.
        rows_of: The set that this is a part of, whose rows its images are known by.
        first_test: Row in the source from which on images are the set's own test part; None = it has none.
        folders: For pictures that are one JPEG file each: the folder of each class, in the order of the classes, to be
            found next to each other in the data set's folder or in a zip file there.
        obtain: What to do to have the data, where it cannot be downloaded; one line.
        traps: Known properties that spoil a careless evaluation.
        files: The files, training part before test part; records: one file a class, in the order of the classes; none
            where there are folders.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    title: str
    folder: str
    source: str
    licence: str
    attribution: str
    kind: Literal["images", "sequences"] = "images"
    shape: tuple[int, ...]
    classes: tuple[str, ...]
    binarisation: str = "none"
    bundled: bool = False
    rows_of: str = ""
    first_test: int | None = None
    folders: tuple[str, ...] = ()
    obtain: str = ""
    traps: tuple[str, ...] = ()
    files: tuple[DataFile, ...] = ()

    @property
    def identity(self) -> str:
        """What images are known by, together with their rows: this set's name, or that of the one it is a part of."""
        return self.rows_of or self.name

    @property
    def origin(self) -> str:
        """Where the data comes from, with its authors and licence, in one line."""
        return f"{self.title}, {self.attribution}, {self.licence}, {self.source}"


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
