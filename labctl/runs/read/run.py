"""Reading a run, be it finished, running or cut short by a crash."""

import hashlib
import logging
import os
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from instruments.values import Drive
from labctl.errors import RunError, UsageError
from labctl.runs.format.columns import LONGEST_KIND, in_this_version
from labctl.runs.format.journal import read_journal
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.own_files import require_own_files
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS
from labctl.runs.format.plan import read_plan
from labctl.runs.format.shards import Shards
from labctl.runs.format.store import is_elsewhere, location
from labctl.runs.read.data_file import DataFile, damaged, evidence_in
from labctl.runs.read.shard_files import ShardFiles

_logger = logging.getLogger(__name__)


class Frames(Protocol):
    """Codes of shape (shots, ports, samples) that are read when they are indexed."""

    @property
    def shape(self) -> tuple[int, ...]:
        """(shots, ports, samples)."""

    @property
    def dtype(self) -> np.dtype[Any]:
        """int8 or int16."""

    def __getitem__(self, key: Any) -> Any:
        """Codes of some shots, ports and samples: NumPy's basic indexing, and ascending indices or a mask of shots."""

    def __len__(self) -> int:
        """Number of shots."""


class Source(Protocol):
    """Where a run's columns come from."""

    @property
    def drive(self) -> Drive | None:
        """What the AWG played, None if nothing."""

    @property
    def frames(self) -> Frames:
        """The codes."""

    @property
    def suspect(self) -> int:
        """How many shots are left out because they are in doubt."""

    def column(self, name: str) -> NDArray[Any]:
        """A whole column of `/shots` length: trigger_offset_s, clipped, epoch, measured_at_s or shots."""

    def planned(self) -> NDArray[Any]:
        """The table of `/shots` as far as the plan fixes it."""

    def scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Scale and offset per port."""

    def close(self) -> None:
        """Let go of files."""


class Run:
    """The shots of a run that are complete on all passes, and what was requested.

    Shots that are in doubt, because a setting was changed from elsewhere while they were measured, are left out:
    `suspect` says how many. A context manager; `close` it otherwise. Everything is read on demand, `frames` only as
    far as indexed.

    Attributes:
        path: the run directory, or the data file that was opened by itself.
        manifest: what manifest.json holds.
        shape: the planned size of the run.
        done: how many shots each pass has.
        source: where the columns come from.
    """

    def __init__(self, path: Path, manifest: Manifest, done: tuple[int, ...], source: Source) -> None:
        """Not for callers: `open_run` opens a run."""
        self.path = path
        self.manifest = dict(manifest.values)
        self.shape = manifest.shape
        self.done = done
        self.source = source

    @property
    def drive(self) -> Drive | None:
        """What the AWG played, None if nothing."""
        return self.source.drive

    @property
    def frames(self) -> Frames:
        """Digitiser codes, (shots, ports, samples), lazily: index it to read."""
        return self.source.frames

    @property
    def suspect(self) -> int:
        """How many shots are left out because they are in doubt."""
        return self.source.suspect

    @property
    def complete(self) -> bool:
        """Whether every planned shot is there."""
        return len(self.frames) == self.shape.shots

    @property
    def ports(self) -> tuple[int, ...]:
        """Ports in the order of `frames`."""
        return self.shape.ports

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample, s, (samples,): after the trigger; of sequences, after their frame's first sample."""
        return self.shape.time

    @property
    def scale(self) -> NDArray[np.float64]:
        """V per code, (ports,); NaN for a port that was not measured yet."""
        return self._scales[0]

    @property
    def offset(self) -> NDArray[np.float64]:
        """V at code 0, (ports,); NaN for a port that was not measured yet."""
        return self._scales[1]

    @cached_property
    def shots(self) -> NDArray[Any]:
        """One record a shot: index, kind (text), dataset_index, label, wavelength_nm, group, epoch, time_s, flags.

        `index` is the place in the plan. `epoch` and `time_s` are of the pass that completed the shot.
        """
        return self._table(self.source.column("shots"))

    @cached_property
    def planned(self) -> NDArray[Any]:
        """`shots` as far as the plan fixes them, read without the shards; epoch, time_s and flags are zero."""
        return self._table(self.source.planned())

    @cached_property
    def trigger_offset_s(self) -> NDArray[np.float64]:
        """Time from the trigger to the sample grid (XZEro), s, (shots, ports)."""
        return self.source.column("trigger_offset_s")

    @cached_property
    def clipped(self) -> NDArray[np.bool_]:
        """Whether a frame touches the end of the digitiser's range, (shots, ports)."""
        return self.source.column("clipped")

    @cached_property
    def epoch(self) -> NDArray[np.int32]:
        """Epoch of each shot on each pass, (shots, passes)."""
        return self.source.column("epoch")

    @cached_property
    def measured_at_s(self) -> NDArray[np.float64]:
        """When each shot was measured on each pass, s since the run began, (shots, passes)."""
        return self.source.column("measured_at_s")

    def volts(self, key: Any = slice(None)) -> NDArray[np.float64]:
        """The signal in V at some index of `frames`: shots, or shots, ports and samples, whose dimensions stay."""
        ports = key[1] if isinstance(key, tuple) and len(key) > 1 else slice(None)
        return volts(self.frames[key], self.scale[ports], self.offset[ports], np.float64)

    def digest(self) -> str:
        """sha256 of `frames` in C order: equal for runs that measured the same bytes."""
        total = hashlib.sha256()
        step = max(1, (1 << 22) // max(1, self.shape.shot_bytes))
        for start in range(0, len(self.frames), step):
            total.update(np.ascontiguousarray(self.frames[start : start + step]).tobytes())
        return total.hexdigest()

    def close(self) -> None:
        """Let go of the file."""
        self.source.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _table(self, stored: NDArray[Any]) -> NDArray[Any]:
        try:
            return _with_text(stored)
        except HDF5_ERRORS as error:
            raise damaged(self.path, error) from error

    @cached_property
    def _scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.source.scales()


def volts(codes: NDArray[np.integer], scale: ArrayLike, offset: ArrayLike, dtype: Any = np.float32) -> NDArray[Any]:
    """Volts of digitiser codes: scale * code + offset.

    Args:
        codes: (shots, ports, samples).
        scale: (ports,) V per code.
        offset: (ports,) V.
        dtype: Type of the result, and what is calculated in.

    Example:
        >>> import numpy as np
        >>> from labctl.runs.read.run import volts
        >>> codes = np.array([[[-128, 0, 127]]], np.int8)  # one shot, one port, three samples
        >>> volts(codes, scale=[0.5], offset=[64])
        array([[[  0. ,  64. , 127.5]]], dtype=float32)
    """
    found: NDArray[Any] = codes * np.asarray(scale, dtype)[:, np.newaxis]
    found += np.asarray(offset, dtype)[:, np.newaxis]
    return found


def _with_text(stored: NDArray[Any]) -> NDArray[Any]:
    """A table of shots with the columns of this version, their kinds as text."""
    table = in_this_version(stored)
    names = table.dtype.names or ()
    return table.astype([(name, f"U{LONGEST_KIND}" if name == "kind" else table.dtype[name]) for name in names])


def open_run(path: Path | str) -> Run:
    """Open a run directory, or a data.h5 by itself, here or by a URL elsewhere.

    From a directory data.h5 is read if it holds exactly what the journal lists, and the shards otherwise: while the run
    goes on, after a crash, after a resume.

    Raises:
        RunError: not a run, or damaged; one line with what is wrong and what to do.
        Unreachable: the store of a URL does not answer.

    Example:
        >>> from labctl.runs.read.run import open_run
        >>> with open_run("runs/mine") as run:
        ...     run.complete, run.ports, run.frames.shape, run.frames.dtype
        (True, (2, 3, 4, 5, 6), (220, 5, 50), dtype('int8'))
    """
    run = _opened(location(path))
    if run.suspect:
        _logger.warning("%s: %s shots are suspect and left out: `labctl resume` measures them again", path, run.suspect)
    return run


def refuse_file(directory: Path) -> None:
    """Refuse data.h5 by itself where the directory of its run is needed.

    Raises:
        UsageError: it is named.
        RunError: a file that is not of a run is named.
    """
    if directory.is_file():
        with _opened(directory):
            raise UsageError(f"{directory}: is a file: name the run directory, {directory.parent} if that is it")


def _opened(path: Path) -> Run:
    if path.is_file():
        if not is_elsewhere(path):
            _require_own_surroundings(path)
        return _of_data_file(path, path, None)
    paths = RunPaths(path)
    manifest = Manifest.read(paths)
    if paths.data.exists() and not paths.journal.exists():
        return _of_data_file(path, paths.data, None)
    plan, drive = read_plan(paths, manifest.values["plan_sha256"])
    shards = Shards(paths, manifest.shape, plan, read_journal(paths.journal).entries)
    if paths.data.exists() and evidence_in(paths.data) == shards.evidence:
        return _of_data_file(path, paths.data, shards.done)
    return Run(path, manifest, shards.done, ShardFiles(shards, drive))


def run_of_shards(path: Path, manifest: Manifest, shards: Shards) -> Run:
    """The shots of some shards of the run in `path`, with a manifest of their shape; without the drive."""
    return Run(path, manifest, shards.done, ShardFiles(shards, None))


def _require_own_surroundings(data: Path) -> None:
    """Refuse a data file beside which figures would be written somewhere else."""
    beside = RunPaths(data.parent)
    if os.path.lexists(beside.manifest):
        require_own_files(beside.directory)
    elif beside.figures.is_symlink():
        raise RunError(f"{beside.figures}: is a link to another place: put the folder itself there")
    else:
        require_own_files(beside.figures)


def _of_data_file(path: Path, data: Path, done: tuple[int, ...] | None) -> Run:
    stored = DataFile(data)
    passes = len(stored.manifest.shape.passes)
    return Run(path, stored.manifest, done or (len(stored.frames),) * passes, stored)
