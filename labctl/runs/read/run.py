"""Reading a run, be it finished, running or cut short by a crash."""

import hashlib
from functools import cached_property
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from labctl.errors import RunError
from labctl.runs.format.journal import read_journal
from labctl.runs.format.layout import HDF5_ERRORS, Manifest, RunPaths, check_version
from labctl.runs.format.plain_hdf5 import check_plain, opened
from labctl.runs.format.plan import read_drive, read_plan
from labctl.runs.format.shards import Block, Shards
from labctl.runs.format.shots import KINDS, PlayedDrive, in_this_version

MOST_BYTES = 1 << 32  # of data.h5 without its frames, which are read piece by piece
PIECE_BYTES = 1 << 26  # of frames put together from shards at a time: about the largest shard


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

    frames: Frames

    def column(self, name: str) -> NDArray[Any]:
        """A whole column of `/shots` length: trigger_offset_s, clipped, epoch, measured_at_s or shots."""

    def planned(self) -> NDArray[Any]:
        """The table of `/shots` as far as the plan fixes it."""

    def scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Scale and offset per port."""

    def close(self) -> None:
        """Let go of files."""


class Run:
    """The shots of a run that are complete on all passes, and what was asked of it.

    A context manager; `close` it otherwise. Nothing is read before it is asked for, `frames` only as far as indexed.

    Attributes:
        path: the run directory, or the data file that was opened by itself.
        manifest: what manifest.json holds.
        shape: the planned size of the run.
        drive: what the AWG played, None if nothing.
        done: how many shots each pass has.
        source: where the columns come from.
    """

    def __init__(
        self, path: Path, manifest: Manifest, drive: PlayedDrive | None, done: tuple[int, ...], source: Source
    ) -> None:
        """Not for callers: `open_run` opens a run."""
        self.path = path
        self.manifest = dict(manifest.values)
        self.shape = manifest.shape
        self.drive = drive
        self.done = done
        self.source = source

    @property
    def frames(self) -> Frames:
        """Digitiser codes, (shots, ports, samples), lazily: index it to read."""
        return self.source.frames

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
        """Time of each sample relative to the trigger, s, (samples,)."""
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
        """`shots` as far as the plan fixes them, read without the shards; epoch, time_s and flags say nothing."""
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

    def volts(self, shots: Any = slice(None)) -> NDArray[np.float64]:
        """Frames of the chosen shots (a slice, ascending indices or a mask) in V, (n, ports, samples)."""
        codes: NDArray[np.int16] = self.frames[shots]
        return self.scale[:, np.newaxis] * codes + self.offset[:, np.newaxis]

    def digest(self) -> str:
        """sha256 of `frames` in C order: equal for runs that measured the same bytes."""
        total = hashlib.sha256()
        step = max(1, (1 << 22) // max(1, len(self.ports) * self.shape.samples * self.shape.dtype.itemsize))
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


def _with_text(stored: NDArray[Any]) -> NDArray[Any]:
    """A table of shots with the columns of this version, their kinds as text."""
    text = f"U{max(map(len, KINDS))}"
    table = in_this_version(stored)
    kinds = [(name, text if name == "kind" else table.dtype[name]) for name in table.dtype.names or ()]
    return table.astype(np.dtype(kinds))


def open_run(path: Path | str) -> Run:
    """Open a run directory, or a data.h5 by itself.

    From a directory data.h5 is read if it holds exactly what the journal says, and the shards otherwise: while the run
    goes on, after a crash, after a resume.

    Raises:
        RunError: not a run, or damaged; says what and what to do.

    Example:
        >>> from labctl.runs.read.run import open_run
        >>> with open_run("runs/mine") as run:
        ...     run.complete, run.ports, run.frames.shape, run.frames.dtype
        (True, (2, 3, 4, 5, 6), (220, 5, 50), dtype('int8'))
    """
    path = Path(path)
    if path.is_file():
        return _from_data_file(path, path, None)
    paths = RunPaths(path)
    _require_own_files(paths)
    manifest = Manifest.read(paths)
    if paths.data.exists() and not paths.journal.exists():
        return _from_data_file(path, paths.data, None)
    plan, drive = read_plan(paths, manifest.values["plan_sha256"])
    shards = Shards(paths, manifest.shape, plan, read_journal(paths.journal).entries)
    if paths.data.exists() and data_file_evidence(paths.data) == shards.evidence:
        return _from_data_file(path, paths.data, shards.done)
    return Run(path, manifest, drive, shards.done, _ShardSource(shards))


def run_of_shards(path: Path, manifest: Manifest, shards: Shards) -> Run:
    """The shots of some shards of the run in `path`, with a manifest of their shape; without the drive."""
    return Run(path, manifest, None, shards.done, _ShardSource(shards))


def _require_own_files(paths: RunPaths) -> None:
    """Refuse a run whose figures, report or readouts would be written somewhere else."""
    for folder in (paths.directory, paths.figures, paths.models):
        for found in folder.iterdir() if folder.is_dir() else ():
            if found.is_symlink():
                raise RunError(f"{found}: is a link to another place; put the file itself there")


def data_file_evidence(path: Path) -> str:
    """Which set of shards a data file was made from.

    Raises:
        RunError: the file is damaged.
    """
    try:
        with opened(path) as file:
            return str(file.attrs["evidence"])
    except HDF5_ERRORS as error:
        raise damaged(path, error) from error


def damaged(path: Path, error: Exception) -> RunError:
    """The one line for a data file that cannot be read."""
    return RunError(f"{path}: not a whole data file ({error}); `labctl verify --rebuild` makes it anew from the shards")


def _from_data_file(path: Path, data: Path, done: tuple[int, ...] | None) -> Run:
    try:
        file = opened(data)
    except OSError as error:
        raise damaged(data, error) from error
    try:
        check_version(file.attrs["format_version"], data)
        check_plain(file, MOST_BYTES, besides="frames")
        manifest = Manifest.parse(file.attrs["manifest"], data)
        source = _FileSource(data, file)
        if source.frames.dtype != manifest.shape.dtype or source.frames.shape[1:] != (
            len(manifest.shape.ports),
            manifest.shape.samples,
        ):
            raise ValueError("its frames are not of the shape in its manifest")
        return Run(path, manifest, read_drive(file), done or (len(source.frames),) * len(manifest.shape.passes), source)
    except (*HDF5_ERRORS, AttributeError) as error:
        file.close()
        raise damaged(data, error) from error
    except RunError:
        file.close()
        raise


class _StoredFrames:
    """The data set `frames` of data.h5."""

    def __init__(self, path: Path, stored: h5py.Dataset) -> None:
        self._path = path
        self._stored = stored

    @property
    def shape(self) -> tuple[int, ...]:
        return tuple(self._stored.shape)

    @property
    def dtype(self) -> np.dtype[Any]:
        dtype: np.dtype[Any] = self._stored.dtype
        return dtype

    def __getitem__(self, key: Any) -> Any:
        try:
            return self._stored[key]
        except OSError as error:
            raise damaged(self._path, error) from error

    def __len__(self) -> int:
        return len(self._stored)


class _FileSource:
    """Columns of data.h5."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        self.frames: Frames = _StoredFrames(path, file["frames"])
        self._path = path
        self._file = file

    def column(self, name: str) -> NDArray[Any]:
        try:
            return np.asarray(self._file[name][:])
        except HDF5_ERRORS as error:
            raise damaged(self._path, error) from error

    def planned(self) -> NDArray[Any]:
        return self.column("shots")

    def scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.column("scale"), self.column("offset")

    def close(self) -> None:
        self._file.close()


class _ShardSource:
    """Columns put together from the shards."""

    def __init__(self, shards: Shards) -> None:
        self.frames: Frames = _ShardFrames(shards)
        self._shards = shards
        self._columns: Block | None = None

    def column(self, name: str) -> NDArray[Any]:
        if self._columns is None:
            self._columns = _without_frames(self._shards)
        return self._columns[name]

    def planned(self) -> NDArray[Any]:
        return self._shards.planned

    def scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self._shards.all_scales()

    def close(self) -> None:
        """Nothing is kept open."""


class _ShardFrames:
    """`/frames` as it would be in data.h5, read from the shards that an index needs."""

    def __init__(self, shards: Shards) -> None:
        self._shards = shards
        self._complete = shards.complete

    @property
    def shape(self) -> tuple[int, ...]:
        return len(self._complete), len(self._shards.shape.ports), self._shards.shape.samples

    @property
    def dtype(self) -> np.dtype[Any]:
        return self._shards.shape.dtype

    def __len__(self) -> int:
        return len(self._complete)

    def __getitem__(self, key: Any) -> NDArray[Any]:
        chosen, *rest = key if isinstance(key, tuple) else (key,)
        if chosen is Ellipsis:
            chosen, rest = slice(None), [Ellipsis, *rest]
        indices = self._complete[chosen]
        if np.ndim(indices) == 0:
            return np.asarray(self._read(np.atleast_1d(indices), tuple(rest))[0])
        return self._read(indices, tuple(rest))

    def _read(self, indices: NDArray[np.int64], rest: tuple[Any, ...]) -> NDArray[Any]:
        """Some shots, piece by piece: beside the result there is one piece of whole shots in memory."""
        row = len(self._shards.shape.ports) * self._shards.shape.samples * self.dtype.itemsize
        step = max(1, PIECE_BYTES // row)
        first: NDArray[Any] = self._shards.block(indices[:step])["frames"][(slice(None), *rest)]
        if len(indices) <= step:
            return first
        frames = np.empty((len(indices), *first.shape[1:]), self.dtype)
        frames[:step] = first
        for start in range(step, len(indices), step):
            piece = self._shards.block(indices[start : start + step])["frames"]
            frames[start : start + step] = piece[(slice(None), *rest)]
        return frames

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        return np.asarray(self[:], dtype)


def _without_frames(shards: Shards) -> Block:
    """All columns but the frames; a run's small columns fit in memory where its frames may not."""
    small: dict[str, list[NDArray[Any]]] = {}
    empty = shards.block(shards.complete[:0])
    for _, block in chain([(0, empty)], shards.blocks()):
        del block["frames"]
        for name, values in block.items():
            small.setdefault(name, []).append(values)
    return {name: np.concatenate(parts) for name, parts in small.items()}
