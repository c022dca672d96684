"""Differences between twin and description that are meant, each with its reason and its source."""

import tomllib
from dataclasses import dataclass
from pathlib import Path

from tests.truth.comparison import Difference

FILE = Path(__file__).with_name("differences.toml")


@dataclass(frozen=True)
class Row:
    """One reason, for one header and the differences it explains."""

    role: str
    header: str
    what: tuple[str, ...]
    reason: str
    source: str

    def explains(self, difference: Difference) -> bool:
        """Whether the difference is one of these."""
        same = (difference.role, difference.header) == (self.role, self.header)
        return same and difference.what in self.what


def rows() -> list[Row]:
    """Every row of `differences.toml`."""
    found = tomllib.loads(FILE.read_text(encoding="utf-8"))["difference"]
    return [
        Row(row["role"], header, tuple(row["what"]), row["reason"], row["source"])
        for row in found
        for header in row["headers"]
    ]
