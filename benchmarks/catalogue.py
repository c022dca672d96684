"""How long it takes to list and to search ten thousand runs.

    python benchmarks/catalogue.py

Seconds to make the catalogue from the runs, once, and then to find all of them, and few. The references, in the same
run: the same rows by `sqlite3` alone from a table that holds them already, and asking the file system about the files
of each run, without which nobody knows whether they have changed.
"""

import json
import sqlite3
import statistics
import sys
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from labctl.runs.catalogue import FILE, Catalogue
from labctl.runs.format.layout import RunPaths
from labctl.runs.index import run_directories
from protocols.image_readout import ImageReadout

RUNS = 10_000
TIMES = 5


def generate(folder: Path, template: Path) -> None:
    """Runs as many as `RUNS`, each with another seed; their journal is the same file."""
    manifest = json.loads((template / "manifest.json").read_text("utf-8"))
    for seed in range(RUNS):
        directory = folder / f"run-{seed:05d}"
        directory.mkdir(parents=True)
        manifest["seeds"]["seed"] = manifest["protocol"]["settings"]["seed"] = seed
        (directory / "manifest.json").write_text(json.dumps(manifest), "utf-8")
        (directory / "journal.jsonl").hardlink_to(template / "journal.jsonl")


def seconds(what: Callable[[], object]) -> float:
    """Of the median of several times."""
    found = []
    for _ in range(TIMES):
        began = time.perf_counter()
        what()
        found.append(time.perf_counter() - began)
    return round(statistics.median(found), 3)


def by_sqlite_alone(path: Path) -> None:
    """Every row of the catalogue."""
    with closing(sqlite3.connect(path)) as database:
        for row, facts in database.execute("SELECT row, facts FROM run ORDER BY name"):
            json.loads(row)
            json.loads(facts)


def by_files_alone(folder: Path) -> None:
    """The sizes and times of the files that the catalogue is made of."""
    for directory in run_directories(folder):
        paths = RunPaths(directory)
        for path in (paths.manifest, paths.journal, paths.notes, paths.models):
            path.exists()


def main() -> None:
    """Measure and print one JSON object."""
    with tempfile.TemporaryDirectory() as place:
        template, folder = Path(place) / "run", Path(place) / "runs"
        acquire(Acquisition(ImageReadout(images=4), SIMULATED_STATION, template))
        generate(folder, template)
        catalogue = Catalogue(folder)
        began = time.perf_counter()
        catalogue.find(limit=1)
        result = {
            "runs": RUNS,
            "made_s": round(time.perf_counter() - began, 2),
            "all_s": seconds(catalogue.find),
            "few_s": seconds(lambda: catalogue.find("seed >= 9990 and protocol = image-readout")),
            "words_s": seconds(lambda: catalogue.find("mnist 9990")),
            "sqlite_alone_s": seconds(lambda: by_sqlite_alone(folder / FILE)),
            "files_alone_s": seconds(lambda: by_files_alone(folder)),
        }
    sys.stdout.write(json.dumps(result) + "\n")


if __name__ == "__main__":
    main()
