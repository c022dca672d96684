"""How long it takes to list and to search ten thousand runs.

Seconds to make the catalogue from the runs, once, to find all of them and few, and of the command that prints all. The
references, in the same run: the same rows by `sqlite3` alone from a table that holds them already, asking the file
system about the files of each run, without which nobody knows whether they changed, and a Python that does nothing.
"""

import json
import sqlite3
import statistics
import tempfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

from benchmarks.commands import python
from benchmarks.rows import REPETITIONS, Goal, Row, interleaved, timed
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from labctl.runs.catalogue import FILE, Catalogue
from labctl.runs.format.layout import RunPaths
from labctl.runs.index import run_directories
from protocols.image_readout import ImageReadout

RUNS = 10_000


def generate(folder: Path, template: Path) -> None:
    """Runs as many as `RUNS`, each with another seed; their journal is the same file."""
    manifest = json.loads((template / "manifest.json").read_text("utf-8"))
    for seed in range(RUNS):
        directory = folder / f"run-{seed:05d}"
        directory.mkdir(parents=True)
        manifest["seeds"]["seed"] = manifest["protocol"]["settings"]["seed"] = seed
        (directory / "manifest.json").write_text(json.dumps(manifest), "utf-8")
        (directory / "journal.jsonl").hardlink_to(template / "journal.jsonl")


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


def rows() -> Iterator[Row]:
    """The catalogue made, then all runs, few by a comparison, few by words, and all by the command."""
    with tempfile.TemporaryDirectory() as place:
        template, folder = Path(place) / "run", Path(place) / "runs"
        acquire(Acquisition(ImageReadout(images=4), SIMULATED_STATION, template))
        generate(folder, template)
        catalogue = Catalogue(folder)
        made = timed(lambda: catalogue.find(limit=1))
        *found, alone, files = interleaved(
            catalogue.find,
            lambda: catalogue.find("seed >= 9990 and protocol = image-readout"),
            lambda: catalogue.find("mnist 9990"),
            lambda: by_sqlite_alone(folder / FILE),
            lambda: by_files_alone(folder),
        )
        commands = ("-m", "labctl", "runs", str(folder)), ("-c", "pass")
        printed, plain = zip(*([python(*words) for words in commands] for _ in range(REPETITIONS)), strict=True)
    wall, bare = (statistics.median(one.wall_s for one in turns) for turns in (printed, plain))
    processor = statistics.median(one.processor_s for one in printed)
    yield Row(
        f"catalogue of {RUNS} runs made once", made.wall_s, "s", made.processor_s, "files asked for", files.wall_s
    )
    for what, one in zip(("all listed", "few found by a comparison", "few found by words"), found, strict=True):
        goal = Goal(most=1.0, of="figure")
        yield Row(
            f"{RUNS} runs: {what}", one.wall_s, "s", one.processor_s, "the rows by sqlite3 alone", alone.wall_s, goal
        )
    yield Row(f"{RUNS} runs: printed", wall, "s", processor, "python -c pass", bare, Goal(most=1.0, of="figure"))
