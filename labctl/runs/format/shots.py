"""The values a run is made of: how large it is, what each shot was meant to be, and what was measured.

Nothing here knows of files. A wrong value is a `ValueError`.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from enum import IntFlag
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from instruments.values import Frames

KINDS = ("image", "reference", "dark", "scene", "sequence")
SHOTS_DTYPE = np.dtype(
    [
        ("index", "<i8"),
        ("kind", "S9"),
        ("dataset_index", "<i8"),
        ("label", "<i8"),
        ("wavelength_nm", "<f8"),
        ("group", "<i8"),
        ("epoch", "<i4"),
        ("time_s", "<f8"),
        ("flags", "<i4"),
        ("next_dataset_index", "<i8"),
        ("next_label", "<i8"),
    ]
)
PLAN_COLUMNS = (
    "index",
    "kind",
    "dataset_index",
    "label",
    "wavelength_nm",
    "group",
    "next_dataset_index",
    "next_label",
)

SINCE_1_1 = ("next_dataset_index", "next_label")


def in_this_version(table: NDArray[Any]) -> NDArray[Any]:
    """A table of shots of any 1.x with the columns of this version: -1 in those that came later than it.

    Raises:
        ValueError, TypeError: it is no table of shots.
    """
    names = table.dtype.names or ()
    if missing := [name for name in SHOTS_DTYPE.names or () if name not in (*names, *SINCE_1_1)]:
        raise ValueError(f"without {missing[0]}")
    found = np.zeros(table.shape, SHOTS_DTYPE)
    for name in SHOTS_DTYPE.names or ():
        found[name] = table[name] if name in names else -1
    return found


class ShotFlag(IntFlag):
    """Bits of the column `flags` of `/shots`."""

    CLIPPED = 1  # at least one frame touches the end of the digitiser's range
    RETRIED = 2  # measured again after an instrument error


@dataclass(frozen=True)
class Durability:
    """When a shard closes, whichever comes first: so much is lost at most when the process dies.

    Attributes:
        shots: shots of one pass.
        seconds: age of the oldest shot that is not on disk yet, by the wall.
        shard_bytes: bytes of samples.
    """

    shots: int = 20
    seconds: float = 1.0
    shard_bytes: int = 64_000_000

    def __post_init__(self) -> None:
        if self.shots < 1 or not self.seconds > 0 or self.shard_bytes < 1:
            raise ValueError(f"{self}: shots, seconds and shard_bytes must be above zero")

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "Durability":
        """From the entry `durability` of a manifest; keys of later minor versions are ignored."""
        return cls(**{name: values[name] for name in cls.__dataclass_fields__ if name in values})


@dataclass(frozen=True)
class RunShape:
    """The size of a run, fixed before its first shot.

    Attributes:
        shots: number of planned shots.
        passes: the ports of each pass, for example ((2, 3, 4, 5), (6,)). `/frames` has its ports in this order.
        samples: samples of one frame.
        sample_interval_s: time between two samples, s.
        code_type: type of a digitiser code, "int16" when frames are averages.
        start_s: time of the first sample relative to the trigger, s.
        wavelengths_nm: laser wavelength of each pass; empty where the run does not say.
    """

    shots: int
    passes: tuple[tuple[int, ...], ...]
    samples: int
    sample_interval_s: float
    code_type: Literal["int8", "int16"] = "int8"
    start_s: float = 0.0
    wavelengths_nm: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if self.shots < 1 or self.samples < 1 or not self.passes or not all(self.passes):
            raise ValueError(f"{self}: a run needs at least one shot, one sample and one port in each pass")
        if len(self.wavelengths_nm) not in (0, len(self.passes)):
            raise ValueError(f"{self}: give one wavelength for each pass, or none")
        traces = list(zip(self.ports, self.wavelength_of_port, strict=True))
        if len(set(traces)) != len(traces):
            raise ValueError(f"{self}: a port is measured in more than one pass of the same wavelength")
        if self.code_type not in ("int8", "int16"):
            raise ValueError(f"{self}: code_type is int8 or int16")

    @property
    def ports(self) -> tuple[int, ...]:
        """Ports in the order of `/frames`."""
        return tuple(port for ports in self.passes for port in ports)

    @property
    def wavelength_of_port(self) -> tuple[float, ...]:
        """Wavelength in nm of each entry of `ports`, 0 where the run does not say."""
        wavelengths = self.wavelengths_nm or (0.0,) * len(self.passes)
        return tuple(wavelength for ports, wavelength in zip(self.passes, wavelengths, strict=True) for _ in ports)

    @property
    def dtype(self) -> np.dtype[Any]:
        """Type of `/frames`, little-endian."""
        return np.dtype(self.code_type).newbyteorder("<")

    @property
    def time(self) -> NDArray[np.float64]:
        """Time of each sample relative to the trigger, s, shape (samples,)."""
        return self.start_s + self.sample_interval_s * np.arange(self.samples, dtype=np.float64)

    def columns(self, pass_index: int) -> slice:
        """Where the ports of a pass lie on the port axis of `/frames`."""
        first = sum(len(ports) for ports in self.passes[:pass_index])
        return slice(first, first + len(self.passes[pass_index]))

    def check(self, pass_index: int, first: int, frames: Frames) -> None:
        """Compare frames of the shots from `first` on, measured on a pass, with the run that they are to be part of.

        Raises:
            ValueError: arrays of another shape or type, or shots that are not planned.
        """
        count, ports = len(frames), len(self.passes[pass_index])
        if frames.codes.shape != (count, ports, self.samples) or frames.codes.dtype != self.dtype:
            raise ValueError(f"frames of {frames.codes.dtype} {frames.codes.shape} are not those of a run of {self}")
        if frames.trigger_offset_s.shape != (count, ports) or frames.clipped.shape != (count, ports):
            raise ValueError(f"trigger_offset_s and clipped must have shape {(count, ports)}")
        if not 0 <= first < first + count <= self.shots:
            raise ValueError(f"shots {first}..{first + count - 1} are not among 0..{self.shots - 1}")

    def to_json(self) -> dict[str, Any]:
        """The entry `shape` of the manifest."""
        return asdict(self) | {"passes": [list(ports) for ports in self.passes]}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "RunShape":
        """The inverse of `to_json`; keys of later minor versions are ignored."""
        known = {name: values[name] for name in cls.__dataclass_fields__ if name in values}
        passes = tuple(tuple(ports) for ports in values["passes"])
        return cls(**known | {"passes": passes, "wavelengths_nm": tuple(values.get("wavelengths_nm", ()))})


@dataclass(frozen=True)
class ShotColumns:
    """What the plan fixes about every shot: arrays of shape (shots,), in the order of measurement.

    Attributes:
        kind: one of `KINDS`.
        dataset_index: index in the data set, -1 for none.
        label: class, -1 for none.
        wavelength_nm: laser wavelength, the first one where a shot is measured at several.
        group: shots of one group stay together when data are split; repeats of one image share a group.
        next_dataset_index, next_label: what a scene's image changes to, -1 for other shots; None: there are no scenes.
    """

    kind: NDArray[Any]
    dataset_index: NDArray[np.int64]
    label: NDArray[np.int64]
    wavelength_nm: NDArray[np.float64]
    group: NDArray[np.int64]
    next_dataset_index: NDArray[np.int64] | None = None
    next_label: NDArray[np.int64] | None = None

    def table(self) -> NDArray[Any]:
        """The columns as `/shots` stores them; epoch, time and flags are still zero.

        Raises:
            ValueError: columns of different lengths, or an unknown kind.
        """
        kinds = np.asarray(self.kind).astype("S")
        if unknown := set(kinds.tolist()) - {kind.encode() for kind in KINDS}:
            raise ValueError(f"kind of a shot is one of {', '.join(KINDS)}, not {sorted(unknown)}")
        table = np.zeros(len(kinds), SHOTS_DTYPE)
        table["index"] = np.arange(len(kinds))
        table["kind"] = kinds
        for name in PLAN_COLUMNS[2:]:
            column = getattr(self, name)
            if column is None:
                column = np.full(table.shape, -1)
            if np.shape(column) != table.shape:
                raise ValueError(f"column {name} has shape {np.shape(column)}, kind has {table.shape}")
            table[name] = column
        return table


@dataclass(frozen=True)
class PlayedDrive:
    """What the AWG plays: samples in -1..1 and marker, both of shape (n,), and the rate in S/s."""

    samples: NDArray[np.float32]
    marker: NDArray[np.bool_]
    sample_rate: float
