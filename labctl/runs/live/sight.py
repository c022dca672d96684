"""What a live view sees, in a file that is replaced at every look, who looks at it, and what it is asked to change."""

import math
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from labctl.runs.format.durable import show_file
from labctl.runs.format.own_files import read_own
from labctl.runs.live.arrays import LONGEST_HEADER, decode, encode

LIVE = ".live"
"""Folder among the runs with a folder for each live view."""
SIGHT, WISHES, LOOKED = "sight", "wishes.json", "looked"
"""Names of files in the folder of a live view."""
RECENT = 16
"""Looks, and repeats of one picture, that are kept as they are: repeatability, histogram and spectrum are of these."""
LARGEST = 1 << 26


@dataclass(frozen=True)
class Sight:
    """The last looks at the channels, and how their levels went since the start.

    Attributes:
        ports: of each row of what follows.
        sample_interval_s: time between two samples, s.
        scale_v, offset_v: (ports,) volts = scale * code + offset.
        recent: (looks, ports, samples) int8 or int16 codes, the newest last.
        elapsed_s: (points,) when the levels were taken, s after the start, ascending.
        level_v: (points, ports) mean of a look, V.
        likeness: (points, ports) correlation with the first look; NaN where there is none.
        peak_v: (ports,) highest level since the start, V.
        looks: how many there were.
        rate_hz: looks a second, breaks left out; 0 where they are the shots of a run.
        repeats: (repeats, ports, samples) codes of one and the same picture; None: `recent` are such.
    """

    ports: tuple[int, ...]
    sample_interval_s: float
    scale_v: NDArray[np.float64]
    offset_v: NDArray[np.float64]
    recent: NDArray[np.signedinteger[Any]]
    elapsed_s: NDArray[np.float64]
    level_v: NDArray[np.float64]
    likeness: NDArray[np.float64]
    peak_v: NDArray[np.float64]
    looks: int
    rate_hz: float
    repeats: NDArray[np.signedinteger[Any]] | None = None

    @property
    def volts(self) -> NDArray[np.float64]:
        """(looks, ports, samples) V."""
        return self._in_volts(self.recent)

    @property
    def repeated_volts(self) -> NDArray[np.float64]:
        """(repeats, ports, samples) V, of one and the same picture."""
        return self._in_volts(self.recent if self.repeats is None else self.repeats)

    def _in_volts(self, codes: NDArray[np.signedinteger[Any]]) -> NDArray[np.float64]:
        return self.scale_v[:, np.newaxis] * codes + self.offset_v[:, np.newaxis]

    @property
    def now_v(self) -> NDArray[np.float64]:
        """(ports,) mean of the last look, V."""
        found: NDArray[np.float64] = self._in_volts(self.recent[-1]).mean(axis=1)
        return found

    @property
    def ends_v(self) -> NDArray[np.float64]:
        """(ports, 2) lowest and highest V that the oscilloscope can tell."""
        limits = np.iinfo(self.recent.dtype)
        return np.stack([self.scale_v * code + self.offset_v for code in (limits.min, limits.max)], axis=1)

    @property
    def range_v(self) -> tuple[float, float]:
        """The lowest and the highest V that the oscilloscope can tell on any of the ports."""
        return float(self.ends_v.min()), float(self.ends_v.max())

    @property
    def clipped(self) -> NDArray[np.float64]:
        """(ports,) part of the samples at either end of the range."""
        limits = np.iinfo(self.recent.dtype)
        at_an_end = (self.recent <= limits.min) | (self.recent >= limits.max)
        part: NDArray[np.float64] = at_an_end.mean(axis=(0, 2))
        return part


_ARRAYS = ["scale_v", "offset_v", "recent", "elapsed_s", "level_v", "likeness", "peak_v"]


def write_sight(directory: Path, sight: Sight) -> None:
    """Put `sight` where a page looks for it, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    values = {
        "ports": sight.ports,
        "sample_interval_s": sight.sample_interval_s,
        "looks": sight.looks,
        "rate_hz": sight.rate_hz,
    }
    show_file(directory / SIGHT, encode(values, {name: getattr(sight, name) for name in _ARRAYS}))


def read_sight(directory: Path) -> Sight | None:
    """What the live view in `directory` sees; None where there is nothing, or nothing that it can have written."""
    try:
        return _sight(*decode(read_own(directory / SIGHT, LARGEST), _ARRAYS))
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def _sight(header: dict[str, Any], found: dict[str, NDArray[Any]]) -> Sight:
    ports = tuple(int(port) for port in header["ports"])
    shapes = {name: array.shape for name, array in found.items()}
    looks, _, samples = shapes["recent"]
    points = len(found["elapsed_s"])
    expected = {
        "recent": (looks, len(ports), samples),
        "elapsed_s": (points,),
        **dict.fromkeys(("scale_v", "offset_v", "peak_v"), (len(ports),)),
        **dict.fromkeys(("level_v", "likeness"), (points, len(ports))),
    }
    interval_s, rate_hz = float(header["sample_interval_s"]), float(header["rate_hz"])
    whole = looks > 0 and samples > 0 and points > 0 and len(ports) > 0 and math.isfinite(rate_hz) and interval_s > 0
    if shapes != expected or not whole or found["recent"].dtype.kind != "i":
        raise ValueError(shapes)
    if not all(np.isfinite(found[name]).all() for name in ("scale_v", "offset_v", "elapsed_s", "level_v", "peak_v")):
        raise ValueError("not finite")
    return Sight(ports=ports, sample_interval_s=interval_s, looks=int(header["looks"]), rate_hz=rate_hz, **found)


class Wishes(BaseModel):
    """What a live view is asked for: light and its settings as text with units, empty for those of the station.

    `anew` counts how often ranges, peaks and the first look are to be taken anew.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    power: str = Field("", max_length=40)
    wavelength: str = Field("", max_length=40)
    drive: bool = True
    anew: int = 0


def ask_for(directory: Path, wishes: Wishes) -> None:
    """Ask the live view in `directory` for something.

    Raises:
        OSError: it cannot be written.
    """
    show_file(directory / WISHES, wishes.model_dump_json().encode())


def wishes_in(directory: Path) -> Wishes:
    """What is asked of the live view in `directory`; what nobody can have asked for counts as nothing."""
    try:
        return Wishes.model_validate_json(read_own(directory / WISHES, LONGEST_HEADER))
    except (OSError, ValidationError):
        return Wishes()


def look_at(directory: Path) -> None:
    """Say that somebody looks at the live view in `directory` now.

    Raises:
        OSError: it cannot be written.
    """
    show_file(directory / LOOKED, b"")


def last_look(directory: Path) -> tuple[int, int] | None:
    """What is another one after each `look_at`; None before the first."""
    try:
        found = os.lstat(directory / LOOKED)
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns
