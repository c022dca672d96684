"""What every protocol is: a frozen description of an acquisition that lists its shots and yields their records."""

import hashlib
from abc import ABC, abstractmethod
from collections.abc import Generator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, PositiveInt

from instruments.bench import Bench
from instruments.interfaces import Burst, Drive, Frames, Scaling


class ProtocolError(Exception):
    """A protocol that cannot be carried out as asked: one line that names the setting and what to do."""


class ShotKind(StrEnum):
    """What a shot is for."""

    IMAGE = "image"
    REFERENCE = "reference"
    DARK = "dark"


@dataclass(frozen=True)
class Images:
    """A set of binary images with labels, whatever it was loaded from.

    images: (n, height, width), True = on. labels: (n,). indices: (n,), each image's place in its source.
    """

    images: NDArray[np.bool_]
    labels: NDArray[np.int64]
    indices: NDArray[np.int64]


@dataclass(frozen=True)
class Shot:
    """One pattern to be measured on every port: its place in the run, what it is for, and where it comes from."""

    index: int
    kind: ShotKind
    dataset_index: int
    label: int
    group: int


@dataclass(frozen=True)
class Leg:
    """A stretch of the run at one wavelength and one patching: the optical path does not change inside it."""

    index: int
    wavelength_nm: float
    patching: dict[int, int]


@dataclass(frozen=True)
class LegStarted:
    """The vertical ranges of a leg are found and locked: what a code of each of its channels means."""

    leg: Leg
    scalings: tuple[Scaling, ...]


@dataclass(frozen=True)
class Record:
    """One shot measured on the channels of one leg."""

    leg: Leg
    shot: Shot
    frames: Frames


@dataclass(frozen=True)
class BurstRecord:
    """Consecutive shots, the first one `first` in the plan, measured on the channels of one leg in one burst."""

    leg: Leg
    first: int
    burst: Burst


Events = Generator[LegStarted | Record | BurstRecord, None, None]


class Measurement(BaseModel, ABC):
    """The base of all protocols: frozen, so that it can be hashed, stored, and carried out again as it was.

    `seed` fixes everything that is drawn at random: which images, their order, the drive. Frames are the mean of
    `averages` triggers. `sample_rate` is the oscilloscope's, S/s.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassVar[str]
    sample_rate: ClassVar[float] = 25e9

    seed: int = 1
    averages: PositiveInt = 1

    def digest(self) -> str:
        """SHA-256 over the name and every setting, in hex: equal protocols have equal digests."""
        return hashlib.sha256(f"{self.name} {self.model_dump_json()}".encode()).hexdigest()

    @abstractmethod
    def shots(self, images: Images) -> Sequence[Shot]:
        """The shots of the run in the order they are measured.

        Raises:
            ProtocolError: the images do not suit the protocol.
        """

    @abstractmethod
    def legs(self, bench: Bench) -> tuple[Leg, ...]:
        """The legs of the run on this bench, wavelength outermost: a laser is never retuned from shot to shot."""

    @abstractmethod
    def check(self, bench: Bench, images: Images) -> None:
        """Find out, before anything is written or lit, whether this bench can measure these images.

        Raises:
            ProtocolError: it cannot.
        """

    @abstractmethod
    def drive(self, bench: Bench) -> Drive:
        """The sequence the AWG plays throughout."""

    @abstractmethod
    def sample_count(self) -> int:
        """Samples of one frame."""

    @abstractmethod
    def duration_s(self, bench: Bench, shots: int) -> float:
        """How long `shots` shots take on real instruments, by their arm, transfer and settling times."""

    @abstractmethod
    def acquire(self, bench: Bench, images: Images, shots: Sequence[Shot]) -> Events:
        """Measure `shots` on every leg: for each leg its ranges, then its records in order.

        Light is on only while the generator runs; closing it, however that happens, leaves the bench in the safe state.
        """
