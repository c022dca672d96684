"""What a long run takes of the machine: memory, files and threads of client, supervisor and simulated bench on the way.

One `labctl run` on two ports, in one pass, against `labctl sim serve`, each a process of its own; 100,000 records in
either timing. A line for every tenth of them goes to standard error; the figures are what a record of the second half
has added to the memory of each process, and what one more record that is planned takes of the client's. Linux only: the
figures are those of /proc.
"""

import json
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np

from benchmarks.rows import Goal, Row
from labctl.runs.live.events import EventReader
from tests.command_line import LABCTL

SETTINGS = ("ports=2,3", "window=0.4 ns", "reference_every=50")
PIXELS = 28
POINTS = 10
RECORDS = 100_000
LOOK_S = 0.1
FLAT = 50.0
"""Bytes a record: what an allocator leaves between its blocks; a kept object of any kind is larger."""


class Process(NamedTuple):
    """What a process takes: resident memory (B), open files, threads."""

    memory: int
    files: int
    threads: int

    @classmethod
    def of(cls, number: int) -> "Process":
        """The process of that number."""
        folder = Path(f"/proc/{number}")
        status = dict(line.split(":", 1) for line in (folder / "status").read_text("utf-8").splitlines())
        memory = 1024 * int(status["VmRSS"].split()[0])
        return cls(memory, len(list((folder / "fd").iterdir())), int(status["Threads"]))

    def __str__(self) -> str:
        """As a cell of the table."""
        return f"{self.memory / 1e6:8.1f} MB {self.files:3d} files {self.threads:2d} threads"


def image_set(folder: Path, count: int) -> Path:
    """A data set of so many random images of two classes."""
    generator = np.random.default_rng(1)
    path = folder / "images.npz"
    images = generator.random((count, PIXELS, PIXELS)) < 0.2
    np.savez_compressed(path, images=images, labels=np.arange(count) % 2)
    return path


@contextmanager
def served(station: Path) -> Iterator[int]:
    """A simulated bench with its addresses in `station`; the number of its process."""
    command = [*LABCTL, "sim", "serve", "--json", "--save-station", str(station)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as bench:  # noqa: S603
        assert bench.stdout is not None  # noqa: S101
        json.loads(bench.stdout.readline())
        try:
            yield bench.pid
        finally:
            bench.send_signal(signal.SIGTERM)


def supervisor_of(client: int) -> int:
    """The one process that a client has started."""
    (child,) = Path(f"/proc/{client}/task/{client}/children").read_text("ascii").split()
    return int(child)


def measured(client: subprocess.Popen[bytes], bench: int, directory: Path, records: int) -> list[list[Process]]:
    """The three processes at each of the points, as the run goes on; prints a row for each."""
    say("records", "client", "supervisor", "bench")
    reader = EventReader(directory / "events.jsonl")
    found: list[list[Process]] = []
    done, supervisor = 0, 0
    while client.poll() is None and len(found) < POINTS - 1:
        time.sleep(LOOK_S)
        for event in reader.read():
            done = int(event.fields["done"]) if event.name == "progress" else done
        if done >= (len(found) + 1) * records / POINTS:
            supervisor = supervisor or supervisor_of(client.pid)
            found.append([Process.of(number) for number in (client.pid, supervisor, bench)])
            say(done, *found[-1])
    return found


def say(*cells: object) -> None:
    """Print a row."""
    sys.stderr.write("".join(f"{cell!s:>34}" if place else f"{cell!s:>8}" for place, cell in enumerate(cells)) + "\n")


def followed(records: int, timing: str) -> list[list[Process]]:
    """Client, supervisor and bench after every tenth of so many records but the last."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        settings = (f"dataset={image_set(folder, records)}", f"images={records}", f"timing={timing}", *SETTINGS)
        with served(folder / "station.toml") as bench:
            command = [*LABCTL, "run", "image-readout", *(word for one in settings for word in ("--set", one))]
            with subprocess.Popen(  # noqa: S603
                [*command, "--station", str(folder / "station.toml"), "--out", str(folder / "run")],
                stdout=subprocess.DEVNULL,
            ) as client:
                found = measured(client, bench, folder / "run", records)
    if client.returncode or len(found) < POINTS - 1:
        raise RuntimeError(f"the run ended with {client.returncode} after {len(found)} of {POINTS - 1} points")
    return found


def rows() -> Iterator[Row]:
    """What a record of the second half adds to each process in either timing, and what one that is planned takes."""
    part = RECORDS * (POINTS - 1 - POINTS // 2) / POINTS
    runs = {timing: followed(RECORDS, timing) for timing in ("software", "burst")}
    for timing, found in runs.items():
        for process, before, last in zip(
            ("client", "supervisor", "bench"), found[POINTS // 2 - 1], found[-1], strict=True
        ):
            what = f"growth of the {process} over the last half of {RECORDS} records, {timing}"
            yield Row(what, (last.memory - before.memory) / part, "B a record", goal=Goal(most=FLAT, of="figure"))
    fewer = RECORDS // POINTS
    client, smaller = runs["software"][-1][0], followed(fewer, "software")[-1][0]
    yield Row(
        f"the client of {RECORDS} records beside that of {fewer}, images and plan included, software",
        (client.memory - smaller.memory) / (RECORDS - fewer),
        "B a record",
    )
