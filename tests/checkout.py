"""The files of the checkout, without what a build of the documents makes in it."""

import os
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"


def files_below(folder: Path) -> Iterator[Path]:
    """Every file; `docs/made`, where a build puts what it measures, is not looked into: it may be going on."""
    for place, folders, names in os.walk(folder):
        if Path(place) == DOCS:
            folders[:] = [name for name in folders if name != "made"]
        yield from (Path(place) / name for name in names)


README = ROOT / "README.md"
PAGES = sorted(path for path in files_below(DOCS) if path.suffix == ".md")
