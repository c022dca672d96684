"""Which runs are there, and how far did they get?

Read from manifests and journals alone, so it is quick; of a run that lacks shots also who writes it.
"""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from labctl.errors import RunError
from labctl.runs.format.journal import read_journal
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import is_elsewhere
from labctl.runs.live.owner import writer_of

LONGEST_TEXT = 200
State = Literal["complete", "running", "incomplete", "unreadable"]
Stamp = tuple[int, int]


@dataclass(frozen=True)
class RunRow:
    """One run of the catalogue.

    Attributes:
        path: the run directory.
        protocol: name of the protocol, empty if the manifest does not say.
        started: UTC time, ISO 8601, empty if the manifest does not say.
        seed: of the protocol.
        twin_seed: of the simulated bench, None on a real one.
        shots: how many are complete.
        planned: how many were planned.
        running: a process of this machine measures what is missing.
        instruments: whether they are real or simulated, or mixed; None if the manifest does not say.
        problem: why the run cannot be read, or empty.
    """

    path: Path
    protocol: str = ""
    started: str = ""
    seed: int | None = None
    twin_seed: int | None = None
    shots: int = 0
    planned: int = 0
    running: bool = False
    instruments: Origin | None = None
    problem: str = ""

    @property
    def name(self) -> str:
        """Name of the directory."""
        return self.path.name

    @property
    def complete(self) -> bool:
        """Whether no shot is missing."""
        return not self.problem and self.shots == self.planned

    @property
    def state(self) -> State:
        """Whether shots are missing, and whether a process measures them; or that the run cannot be read."""
        if self.problem:
            return "unreadable"
        if self.complete:
            return "complete"
        return "running" if self.running else "incomplete"


def run_directories(folder: Path) -> list[Path]:
    """The run directories in `folder`, by name; none if there is no such folder.

    Raises:
        RunError: of a folder elsewhere, if nothing is there: it is not the one in which the first run will be made.
    """
    if not folder.is_dir():
        if is_elsewhere(folder):
            raise RunError(f"{folder}: nothing is there: name a folder with runs in it")
        return []
    return [path for path in sorted(folder.iterdir()) if is_there(RunPaths(path).manifest)]


def is_there(path: Path) -> bool:
    """Whether there is something of that name, were it a link that leads nowhere."""
    return path.exists() if is_elsewhere(path) else os.path.lexists(path)


def stamp(path: Path) -> Stamp | None:
    """What is another one of any file that is put where this one is; None where there is none, or it is elsewhere."""
    try:
        found = None if is_elsewhere(path) else os.lstat(path)
    except OSError:
        found = None
    return None if found is None else (found.st_ino, found.st_mtime_ns)


def run_row(paths: RunPaths) -> RunRow:
    """One run as the catalogue has it; one that cannot be read has its `problem`."""
    row, _ = row_and_values(paths)
    return row


def row_and_values(paths: RunPaths) -> tuple[RunRow, Mapping[str, Any]]:
    """The same, with what its manifest holds: nothing where it cannot be read."""
    try:
        manifest = Manifest.read(paths)
        shots = sum(entry.shots for entry in read_journal(paths.journal).entries)
    except RunError as error:
        return RunRow(paths.directory, problem=str(error)), {}
    values = manifest.values
    protocol = values.get("protocol", "")
    seeds = values.get("seeds", values)
    row = RunRow(
        path=paths.directory,
        protocol=str(protocol.get("name", "") if isinstance(protocol, dict) else protocol)[:LONGEST_TEXT],
        started=str(values.get("started", ""))[:LONGEST_TEXT],
        seed=_number(seeds, "seed"),
        twin_seed=_number(seeds, "twin_seed"),
        shots=shots,
        planned=manifest.shape.shots,
        running=shots < manifest.shape.shots and is_running(paths),
        instruments=origin_of(values),
    )
    return row, values


def is_running(paths: RunPaths) -> bool:
    """Whether a process of this machine writes the run; of a run elsewhere nobody here can say."""
    return not is_elsewhere(paths.directory) and writer_of(paths) is not None


def origin_of(manifest: Mapping[str, Any]) -> Origin | None:
    """Whether the instruments of a run are real or simulated, or some of each; None if its manifest does not say."""
    return Origin.of(manifest) if isinstance(manifest.get("station"), dict) else None


def _number(values: Any, name: str) -> int | None:
    found = values.get(name) if isinstance(values, dict) else None
    return found if isinstance(found, int) else None
