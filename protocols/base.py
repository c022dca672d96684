"""What every protocol is: a frozen description of an acquisition that lists its shots and yields their records."""

import hashlib
import math
from abc import ABC, abstractmethod
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from importlib.util import decode_source
from pathlib import Path
from typing import Annotated, Any, ClassVar, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from instruments.bench import Bench
from instruments.errors import LabctlError
from instruments.values import Drive, Frames, Scaling

MOST_AVERAGES = 10_240
"""Triggers of one frame."""


class ProtocolError(LabctlError):
    """A protocol that cannot be carried out as asked: one line that names the setting and what to do."""


class ShotKind(StrEnum):
    """What a shot is for. A pattern calibrates; what is alone lacks the reference that else stands beside it."""

    IMAGE = "image"
    IMAGE_ALONE = "image-alone"
    PATTERN = "pattern"
    PATTERN_ALONE = "pattern-alone"
    REFERENCE = "reference"
    DARK = "dark"
    SCENE = "scene"
    SEQUENCE = "sequence"


class Judgement(StrEnum):
    """How a run of a protocol is judged.

    READOUT: with a readout that is trained on a part of it. ITSELF: by what its records say, without a readout.
    EXPERIMENT: together with other runs, by an experiment that acquires all that it needs. NONE: not by labctl.
    """

    READOUT = "readout"
    ITSELF = "itself"
    EXPERIMENT = "experiment"
    NONE = "none"


class Seeds(NamedTuple):
    """What is drawn at random, each from a seed of its own: which images or sequences, their order, the drive."""

    images: int
    order: int
    drive: int


@dataclass(frozen=True)
class SourceFile:
    """A file of Python that defines a protocol: where it lies, and its bytes as they were when it was read."""

    path: Path
    content: bytes

    @property
    def sha256(self) -> str:
        """Digest of the bytes, in hex."""
        return hashlib.sha256(self.content).hexdigest()

    @property
    def text(self) -> str:
        """What the bytes say, by the encoding that they name, else UTF-8."""
        return decode_source(self.content)


class Inputs(Protocol):
    """What is shown or played to the bench."""

    @property
    def digest(self) -> str:
        """SHA-256 over everything in it, in hex."""

    @property
    def source(self) -> str:
        """What its source is known by, empty where nothing says: inputs of one source and place are the same."""


@dataclass(frozen=True)
class Images:
    """A set of binary images with labels, whatever it was loaded from.

    images: (n, height, width), True = on. labels: (n,). indices: (n,), each image's place in its source. source: what
    tells that from others, empty where nothing does: images of one source and place are the same image.
    """

    images: NDArray[np.bool_]
    labels: NDArray[np.int64]
    indices: NDArray[np.int64]
    source: str = ""

    @cached_property
    def places(self) -> Mapping[int, int]:
        """Index in the source -> place among these."""
        return _places(self.indices)

    @property
    def digest(self) -> str:
        """SHA-256 over pixels and labels."""
        return _sha256(self.images, self.labels)

    @property
    def identical(self) -> int:
        """How many of them have the same pixels as another one."""
        packed = np.packbits(self.images.reshape(len(self.images), -1), axis=1)
        alike = np.unique_counts(packed.view(f"V{packed.shape[1]}")).counts
        return int(alike[alike > 1].sum())


@dataclass(frozen=True)
class Sequences:
    """A set of sequences of numbers with labels.

    values: (n, symbols). labels: (n,), -1 where there are no classes. groups: (n,), what must stay together when the
    set is split, a speaker for instance. indices: (n,), each sequence's place in its source. source: as of `Images`.
    """

    values: NDArray[np.float64]
    labels: NDArray[np.int64]
    groups: NDArray[np.int64]
    indices: NDArray[np.int64]
    source: str = ""

    @cached_property
    def places(self) -> Mapping[int, int]:
        """Index in the source -> place among these."""
        return _places(self.indices)

    @property
    def digest(self) -> str:
        """SHA-256 over values and labels."""
        return _sha256(self.values, self.labels)


@dataclass(frozen=True, slots=True)
class Shot:
    """One pattern to be measured on every port: its place in the run, what it is for, and where it comes from.

    A scene also has what its image changes to: `next_dataset_index` and `next_label`, -1 everywhere else.
    """

    index: int
    kind: ShotKind
    dataset_index: int
    label: int
    group: int
    next_dataset_index: int = -1
    next_label: int = -1


@dataclass(frozen=True)
class Pass:
    """A stretch of the run at one wavelength and one patching: the optical path does not change inside it."""

    index: int
    wavelength_nm: float
    patching: dict[int, int]


@dataclass(frozen=True)
class Part:
    """What is to be measured on one pass: `shots`, in the order of the plan.

    `scalings` are the vertical ranges of the pass if they were found before, in an earlier part of the same run: all
    codes of a pass share them. `plan` is all shots of the run, where they are at hand: a protocol need not list them
    once more.
    """

    pass_: Pass
    shots: Sequence[Shot]
    scalings: tuple[Scaling, ...] | None = None
    plan: Sequence[Shot] = ()


@dataclass(frozen=True)
class PassStarted:
    """Measuring on a pass begins, with its vertical ranges locked: what a code of each of its channels means."""

    pass_: Pass
    scalings: tuple[Scaling, ...]


@dataclass(frozen=True)
class Record:
    """Consecutive shots, the first one `first` in the plan, measured on the channels of one pass."""

    pass_: Pass
    first: int
    frames: Frames


InputsT = TypeVar("InputsT", bound=Inputs)

Seed = Annotated[int, Field(ge=0, lt=1 << 32)]
OWN_SEEDS = frozenset({"image_seed", "order_seed", "drive_seed"})

Events = Generator[PassStarted | Record, None, None]


class Measurement(BaseModel, ABC, Generic[InputsT]):
    """The base of all protocols: frozen, so that it can be hashed, stored, and carried out again as it was.

    `seed` fixes everything that is drawn at random: which images or sequences, their order, the drive; `image_seed`,
    `order_seed` and `drive_seed` draw one of these from another seed. Frames are the mean of `averages` triggers, each
    with the same weight. `sample_rate` is the oscilloscope's, S/s. `projector`: the light comes by multimode fibre and
    DMD; otherwise it goes from the modulator straight into the chip. `takes`: what is shown or played, `Images` by the
    settings `dataset`, `classes`, `images`, `binarisation`, or `Sequences` by `dataset`, `classes`, `symbols`.
    `source_file`: the one that defines it, where it comes from no package.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassVar[str]
    sample_rate: ClassVar[float] = 25e9
    projector: ClassVar[bool] = True
    takes: ClassVar[type[Images | Sequences]] = Images
    judgement: ClassVar[Judgement] = Judgement.NONE
    added_settings: ClassVar[frozenset[str]] = frozenset()
    source_file: ClassVar[SourceFile | None] = None

    seed: Seed = 1
    image_seed: Seed | None = None
    order_seed: Seed | None = None
    drive_seed: Seed | None = None
    averages: Annotated[int, Field(ge=1, le=MOST_AVERAGES)] = 1

    def digest(self) -> str:
        """SHA-256 over name, file if there is one, and every setting, in hex: equal protocols have equal digests.

        Settings of `added_settings`, and seeds beside `seed`, count where they are not at their defaults only.
        """
        fields = type(self).model_fields
        added = self.added_settings | OWN_SEEDS
        as_before = {name for name in added if getattr(self, name) == fields[name].default}
        named = self.name if self.source_file is None else f"{self.name} {self.source_file.sha256}"
        return hashlib.sha256(f"{named} {self.model_dump_json(exclude=as_before)}".encode()).hexdigest()

    @property
    def seeds(self) -> Seeds:
        """Those that are asked for, and `seed` for all others."""
        own = (self.image_seed, self.order_seed, self.drive_seed)
        return Seeds(*(self.seed if one is None else one for one in own))

    @abstractmethod
    def shots(self, inputs: InputsT) -> Sequence[Shot]:
        """The shots of the run in the order they are measured.

        Raises:
            ProtocolError: the inputs do not suit the protocol.
        """

    @abstractmethod
    def passes(self, bench: Bench) -> tuple[Pass, ...]:
        """The passes of the run on this bench, wavelength outermost: a laser is never retuned from shot to shot."""

    @abstractmethod
    def check(self, bench: Bench, inputs: InputsT) -> None:
        """Find out, before anything is written or lit, whether this bench can measure these inputs.

        Raises:
            ProtocolError: it cannot.
        """

    def check_cabling(self, bench: Bench) -> None:
        """Compare the light's way with the one the protocol is for.

        Raises:
            ProtocolError: the station says that it is the other one.
        """
        if self.projector == bench.wiring.projector:
            return
        needed = "needs fibre and DMD in" if self.projector else "sends light straight into the chip: take them out of"
        raise ProtocolError(
            f"{bench.source}: wiring.projector = {str(bench.wiring.projector).lower()}, but {self.name} {needed} the "
            f"light's way, and set wiring.projector = {str(self.projector).lower()}"
        )

    @abstractmethod
    def drive(self, bench: Bench, inputs: InputsT) -> Drive:
        """The sequence the AWG plays throughout."""

    @abstractmethod
    def sample_count(self, inputs: InputsT) -> int:
        """Samples of one frame.

        Raises:
            ProtocolError: the time that is asked for is not a whole number of them.
        """

    def start_s(self, bench: Bench, inputs: InputsT) -> float:
        """Of a frame's first sample: how long after the trigger, s; 0 where each frame has a place of its own.

        Raises:
            ProtocolError: this bench cannot measure these inputs.
        """
        return 0.0

    @abstractmethod
    def duration_s(self, bench: Bench, shots: int) -> float:
        """How long `shots` shots take on real instruments, by their arm, transfer and settling times."""

    def most_together(self) -> float:
        """How many shots come, and are stored, together at most; infinite where each comes by itself."""
        return math.inf

    def parts(self, bench: Bench, inputs: InputsT) -> tuple[Part, ...]:
        """The whole run: every shot on every pass.

        Raises:
            ProtocolError: the inputs do not suit the protocol.
        """
        shots = self.shots(inputs)
        return tuple(Part(pass_, shots, plan=shots) for pass_ in self.passes(bench))

    @abstractmethod
    def acquire(self, bench: Bench, inputs: InputsT, parts: Sequence[Part]) -> Events:
        """Measure `parts` one after the other: for each its ranges, found or set again, then its records in order.

        A run is measured whole (`self.parts`), or from where it was cut off: every setting of a pass is sent when its
        part begins, so that the records are those of an uninterrupted run.

        Light is on only while the generator runs; closing it, however that happens, leaves the bench in the safe state.
        """


def _places(indices: NDArray[np.int64]) -> Mapping[int, int]:
    return {index: place for place, index in enumerate(indices.tolist())}


def _sha256(*arrays: NDArray[Any]) -> str:
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()
