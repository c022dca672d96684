"""data.h5 as it is read: what describes it first, through a file that is safe to look at, then its arrays."""

from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from instruments.remedies import unreadable
from instruments.values import Drive
from labctl.errors import RunError
from labctl.runs.format import readout
from labctl.runs.format.columns import require_array, require_table, sizes_of
from labctl.runs.format.manifest import Manifest
from labctl.runs.format.own_files import own_file, place_of
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, attribute, check_plain, walked
from labctl.runs.format.plan import read_drive
from labctl.runs.format.store import mended
from labctl.runs.format.version import check_version

MOST_BYTES = 1 << 32  # of data.h5 without its frames, which are read piece by piece


def evidence_in(path: Path) -> str:
    """Which set of shards a data file was made from.

    Raises:
        RunError: the file is damaged.
    """
    return _attribute(path, "evidence")


def manifest_in(path: Path) -> Manifest:
    """The manifest of the run that a data file was made of.

    Raises:
        RunError: the file is damaged.
    """
    return Manifest.parse(_attribute(path, "manifest"), path)


def _attribute(path: Path, name: str) -> str:
    try:
        with walked(path) as file:
            return str(attribute(file, name))
    except HDF5_ERRORS as error:
        raise damaged(path, error) from error


def damaged(path: Path, error: Exception) -> RunError:
    """The one line for a data file that cannot be read."""
    remedy = mended(path, "`labctl verify --rebuild` makes it anew from the shards")
    if isinstance(error, OSError) and error.errno:
        return RunError(unreadable(path, error, remedy))
    return RunError(f"{path}: not a whole data file ({error}); {remedy}")


def _require_open(path: Path, stored: h5py.File | h5py.Dataset) -> None:
    """Refuse what was closed, of which HDF5 has nothing to say, or says that it is damaged."""
    if not stored:
        raise RunError(f"{path}: is closed: open it again")


class DataFile:
    """A data.h5: its description, and its columns, which are read on demand.

    Attributes:
        manifest: what manifest.json holds.
        frames: `/frames`, read when it is indexed.
        suspect: how many shots are left out because they are in doubt.
    """

    def __init__(self, path: Path) -> None:
        """Open the file at `path`.

        Raises:
            RunError: it is damaged, no data file, or of a later major version.
        """
        self._path = path
        with ExitStack() as stack:
            try:
                stack.callback((stored := own_file(path)).close)
                self._described = stack.enter_context(walked(stored))
                if "format" in self._described.attrs and attribute(self._described, "format") == readout.FORMAT:
                    raise RunError(f"{path}: is a readout, not a run: name a run directory")
                check_version(attribute(self._described, "format_version"), path)
                check_plain(self._described, MOST_BYTES, besides="frames")
                self.manifest = Manifest.parse(attribute(self._described, "manifest"), path)
                shape, found = self.manifest.shape, self._described["frames"]
                if found.dtype != shape.dtype or found.shape[1:] != (len(shape.ports), shape.samples):
                    raise ValueError("its frames are not of the shape in its manifest")
                # Without a cache of chunks HDF5 reads codes straight into the array that is returned.
                cache_bytes = 0 if found.compression is None else None
                self._file = stack.enter_context(h5py.File(place_of(stored, path), "r", rdcc_nbytes=cache_bytes))
                self.frames: StoredFrames | SoundFrames = StoredFrames(path, self._file["frames"])
                self._sizes = sizes_of(shape, len(self.frames))
                marked = "suspect" in self._described.attrs
                self.suspect = int(attribute(self._described, "suspect")) if marked else 0
                self._rows: slice | NDArray[np.intp] = slice(None)
                if self.suspect:
                    self._rows = np.flatnonzero(self._whole("shots")["suspect"] == 0)
                    self.frames = SoundFrames(self.frames, self._rows)
            except HDF5_ERRORS as error:
                raise damaged(path, error) from error
            self._open = stack.pop_all()

    @cached_property
    def drive(self) -> Drive | None:
        """What the AWG played, None if nothing.

        Raises:
            RunError: it is damaged, or closed.
        """
        _require_open(self._path, self._described)
        try:
            return read_drive(self._described)
        except HDF5_ERRORS as error:
            raise damaged(self._path, error) from error

    def column(self, name: str) -> NDArray[Any]:
        """A data set with a value for each shot, other than the frames.

        Raises:
            RunError: it is damaged, or closed.
        """
        return self._whole(name)[self._rows]

    def planned(self) -> NDArray[Any]:
        """The table `/shots`."""
        return self.column("shots")

    def scales(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Scale and offset per port."""
        return self._whole("scale"), self._whole("offset")

    def close(self) -> None:
        """Let go of the file."""
        self._open.close()

    def _whole(self, name: str) -> NDArray[Any]:
        _require_open(self._path, self._file)
        try:
            values = np.asarray(self._file[name][:])
            if name == "shots":
                require_table(values, self._sizes["shot"])
            else:
                require_array(name, values, self._sizes)
            return values
        except HDF5_ERRORS as error:
            raise damaged(self._path, error) from error


class StoredFrames:
    """The data set `/frames`."""

    def __init__(self, path: Path, stored: h5py.Dataset) -> None:
        """Of the data file at `path`."""
        self._path = path
        self._stored = stored
        self.shape: tuple[int, ...] = stored.shape
        self.dtype: np.dtype[Any] = stored.dtype

    def __getitem__(self, key: Any) -> Any:
        _require_open(self._path, self._stored)
        try:
            return self._stored[key]
        except ValueError:  # of h5py where many positions are asked for of a stretch of nothing
            found = np.broadcast_to(np.zeros((), self.dtype), self.shape)[key]
            if found.size:
                raise
            return found
        except OSError as error:
            raise damaged(self._path, error) from error

    def __len__(self) -> int:
        return self.shape[0]


class SoundFrames:
    """The rows of `/frames` that are not in doubt."""

    def __init__(self, stored: StoredFrames, rows: NDArray[np.intp]) -> None:
        """The ascending `rows` of what is `stored`."""
        self._stored = stored
        self._rows = rows
        self.shape: tuple[int, ...] = (len(rows), *stored.shape[1:])
        self.dtype = stored.dtype

    def __getitem__(self, key: Any) -> Any:
        chosen, *rest = key if isinstance(key, tuple) else (key,)
        if chosen is Ellipsis:
            return self._stored[(self._rows, Ellipsis, *rest)]
        return self._stored[(self._rows[chosen], *rest)]

    def __len__(self) -> int:
        return self.shape[0]
