"""Which runs are there, and how far did they get? Read from manifests and journals alone, so it is quick."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from labctl.runs.journal import read_journal
from labctl.runs.layout import Manifest, RunError, RunPaths


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
        problem: why the run cannot be read, or empty.
    """

    path: Path
    protocol: str = ""
    started: str = ""
    seed: int | None = None
    twin_seed: int | None = None
    shots: int = 0
    planned: int = 0
    problem: str = ""

    @property
    def name(self) -> str:
        """Name of the directory."""
        return self.path.name

    @property
    def complete(self) -> bool:
        """Whether no shot is missing."""
        return not self.problem and self.shots == self.planned


def list_runs(folder: Path | str) -> list[RunRow]:
    """The runs in `folder`, by name, which is by time; none if there is no such folder.

    A run that cannot be read is a row with its `problem`; what is no run directory is left out.
    """
    folder = Path(folder)
    if not folder.is_dir():
        return []
    return [_row(RunPaths(path)) for path in sorted(folder.iterdir()) if RunPaths(path).manifest.is_file()]


def _row(paths: RunPaths) -> RunRow:
    try:
        manifest = Manifest.read(paths)
        shots = sum(entry.shots for entry in read_journal(paths.journal).entries)
    except RunError as error:
        return RunRow(paths.directory, problem=str(error))
    values = manifest.values
    protocol = values.get("protocol", "")
    seeds = values.get("seeds", values)
    return RunRow(
        path=paths.directory,
        protocol=str(protocol.get("name", "") if isinstance(protocol, dict) else protocol),
        started=str(values.get("started", "")),
        seed=_number(seeds, "seed"),
        twin_seed=_number(seeds, "twin_seed"),
        shots=shots,
        planned=manifest.shape.shots,
    )


def _number(values: Any, name: str) -> int | None:
    found = values.get(name) if isinstance(values, dict) else None
    return found if isinstance(found, int) else None
