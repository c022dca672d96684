"""The list of runs as a page asks for it: words, columns, an order and how many; by the catalogue beside the runs."""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

from labctl.errors import UsageError
from labctl.runs.catalogue import LISTED, Catalogue, Found

SHOWN = 200
"""Rows of a list, and how many more come at a time."""
EVERY_S = 2.0
RESTS = 10.0
"""The runs are looked at for a tenth of the time at most, however many there are."""
USUAL_ORDER = "started"
MOST_COLUMNS = 8


@dataclass(frozen=True)
class Wanted:
    """What a list is to show: runs that `words` ask for, by `sort`, the last `most`, and `columns` of each."""

    words: str = ""
    columns: tuple[str, ...] = ()
    sort: str = USUAL_ORDER
    most: int = SHOWN

    @classmethod
    def of(cls, asked: Mapping[str, str]) -> "Wanted":
        """By the address of a page: `where`, `columns` and `sort`, as of `labctl runs`."""
        columns = [key.strip().lower() for key in asked.get("columns", "").split(",")]
        return cls(
            asked.get("where", ""), tuple(filter(None, columns))[:MOST_COLUMNS], asked.get("sort") or USUAL_ORDER
        )

    @property
    def address(self) -> str:
        """What follows the `?` in the address of the page that shows it; empty where nothing is special."""
        said = {"where": self.words, "columns": ",".join(self.columns)}
        said["sort"] = "" if self.sort == USUAL_ORDER else self.sort
        return urlencode({key: value for key, value in said.items() if value})


@dataclass(frozen=True)
class Runs:
    """What is to be shown, the newest or largest first, and how many there are; `refused`: why it is not understood."""

    wanted: Wanted
    found: tuple[Found, ...] = ()
    total: int = 0
    refused: str = ""


class Listing:
    """The runs in a folder; what was found is kept for a while."""

    def __init__(self, folder: Path, clock: Callable[[], float] = time.monotonic) -> None:
        """Of `folder`, which need not exist yet."""
        self._catalogue = Catalogue(folder, rests=RESTS)
        self._clock = clock
        self._due = clock()
        self._kept: dict[Wanted, Runs] = {}

    def runs(self, wanted: Wanted) -> Runs:
        """The runs that are wanted; an order that no run here has is the usual one."""
        began = self._clock()
        if began >= self._due:
            self._kept.clear()
            self._due = began + EVERY_S
        if wanted not in self._kept:
            self._kept[wanted] = self._asked(wanted)
            self._due += RESTS * (self._clock() - began)
        return self._kept[wanted]

    def names(self, words: str) -> list[str]:
        """Of the runs that `words` ask for, the latest first; none where no run has what they compare."""
        return [one.row.name for one in self.runs(Wanted(words)).found]

    def keys(self) -> list[str]:
        """What runs can be sorted by and shown with."""
        return sorted({*self._catalogue.keys(), *LISTED})

    def has(self, name: str) -> bool:
        """Whether there is a run of that name."""
        return self._catalogue.has(name)

    def look_again(self) -> None:
        """The next list is read anew."""
        self._due = self._clock()
        self._catalogue.look_again()

    def _asked(self, wanted: Wanted) -> Runs:
        sort = wanted.sort if wanted.sort == USUAL_ORDER or wanted.sort in self.keys() else USUAL_ORDER
        try:
            found, total = self._catalogue.last(wanted.words, sort=sort, limit=wanted.most)
        except UsageError as error:
            return Runs(wanted, refused=str(error))
        return Runs(wanted, tuple(reversed(found)), total)
