"""The main experiment: show each image, trigger the drive, capture the window on every port."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Annotated, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt

from instruments.bench import Bench
from instruments.units import Seconds
from instruments.values import Drive, Frames, Timebase
from protocols.base import (
    Events,
    Images,
    Judgement,
    Measurement,
    Part,
    Pass,
    PassStarted,
    ProtocolError,
    Record,
    Shot,
    ShotKind,
)
from protocols.bursts import PictureMemory, burst_dmd, frame_start_s, measure_bursts, shots_a_burst
from protocols.means import rescaled
from protocols.patterns import Patterns
from protocols.ranging import lock_ranges
from protocols.settings import Binarisation, Classes, ImageCount, Ports, Wavelengths, passes_for, samples_in

Timing = Literal["software", "burst"]

DRIVE_RATE = 25e9
DRIVE_SAMPLES = 2500
"""One period of the drive, 100 ns: above the AWG's minimum and longer than the fibre's delay spread."""
PROBES = 40
SHORTEST_WINDOW_S, LONGEST_WINDOW_S = 40e-12, 20e-6
"""One sample, and two hundred periods of the drive: half a million samples."""

MOST_OFF = 0.25
"""Of the distance between the closest wavelengths of a run: so far a laser may settle from what it is asked for."""

MEAN_FINER = 256
"""Codes of 8 bits are so many times as fine in the mean of a burst's triggers: it fills int16."""

REAL_SHOT_S = 50e-3
"""A software-timed shot on real instruments: a DMD upload (5 ms), arming (20 ms), four transfers (5 ms each)."""
REAL_MEAN_S = 450e-3
"""The same of several triggers: FastFrame, of which the mean is made, gets ready in 400 ms."""
REAL_UPLOAD_S = 5e-3
REAL_PICTURE_S = 50e-6
"""A picture of a burst, and its part of the transfers."""
REAL_BURST_S = 450e-3
"""FastFrame gets ready in 400 ms; four transfers."""
REAL_PASS_S = 5.0
"""Retuning, repatching by switch, and ranging, on real instruments."""


class ImageReadout(Measurement[Images]):
    """Show each image, trigger the drive, capture the window on every port.

    `images` is how many in all, in equal parts of each class, how many of each class ("2000,500"), or "all" that the
    data set has of the classes. `binarisation` is the rule by which grey pixels are on; a data set that is binary
    already stays as it is. Port 0 is the collection fibre before the chip. A reference image and a dark frame follow
    every `reference_every` images, so that drift can be seen. Between bursts the oscilloscope gets ready, for half a
    second; one burst of at most `longest_burst` shots, if it holds them all, has no pause in which a bench could drift.
    """

    name: ClassVar[str] = "image-readout"
    judgement: ClassVar[Judgement] = Judgement.READOUT
    added_settings: ClassVar[frozenset[str]] = frozenset({"longest_burst"})

    dataset: str = "mnist-0-3"
    classes: Classes | None = None
    images: ImageCount = 1000
    binarisation: Binarisation = "128"
    ports: Ports = (2, 3, 4, 5, 6)
    window: Annotated[Seconds, Field(ge=SHORTEST_WINDOW_S, le=LONGEST_WINDOW_S)] = 2e-9
    wavelengths: Wavelengths = (1550.0,)
    timing: Timing = "software"
    longest_burst: PositiveInt | None = None
    reference_every: Annotated[int, Field(ge=1, le=1_000_000)] = 20

    def shots(self, inputs: Images) -> Sequence[Shot]:
        """A class-balanced random order of the images, with a reference and a dark frame after every few.

        Classes alternate throughout, so that no slow drift of the bench can follow the labels.
        """
        order = balanced_order(inputs.labels, np.random.default_rng((self.seeds.order, 1)))
        reference = order[0]
        shots: list[Shot] = []
        for place, image in enumerate(order, start=1):
            shots.append(_shot(len(shots), ShotKind.IMAGE, inputs, image))
            if place % self.reference_every == 0 or place == len(order):
                shots.append(_shot(len(shots), ShotKind.REFERENCE, inputs, reference))
                shots.append(Shot(len(shots), ShotKind.DARK, -1, -1, -1))
        return shots

    def passes(self, bench: Bench) -> tuple[Pass, ...]:
        """Every wavelength with every patching that the ports need."""
        return passes_for(bench, self.wavelengths, self.ports)

    def check(self, bench: Bench, inputs: Images) -> None:
        """The images must fit the DMD, and a frame of a burst its picture."""
        self.start_s(bench, inputs)
        Patterns(inputs, bench.dmd.shape)

    def check_cabling(self, bench: Bench) -> None:
        """As of every protocol, and bursts need cables of their own."""
        super().check_cabling(bench)
        if self.timing == "burst":
            burst_dmd(bench)

    def drive(self, bench: Bench, inputs: Images) -> Drive:
        """Uniform pseudorandom samples at 25 GS/s, fixed by the seed."""
        return pseudorandom_drive(bench, self.seeds.drive)

    def sample_count(self, inputs: Images) -> int:
        """The window in samples of 40 ps."""
        return samples_in("window", self.window, self.sample_rate)

    def start_s(self, bench: Bench, inputs: Images) -> float:
        """At the trigger, or in a burst once the drive has settled."""
        return stills_start_s(
            bench, self.drive(bench, inputs), self.sample_count(inputs) / self.sample_rate, self.timing
        )

    def duration_s(self, bench: Bench, shots: int) -> float:
        """Arm, transfer and settling times of real instruments, pass by pass."""
        return stills_duration_s(len(self.passes(bench)), shots, self.averages, self.most_together())

    def most_together(self) -> float:
        """The shots of a burst."""
        return shots_a_burst(self.averages, self.longest_burst) if self.timing == "burst" else math.inf

    def acquire(self, bench: Bench, inputs: Images, parts: Sequence[Part]) -> Events:
        """Shot by shot: show, arm, wait for the marker of the running drive, read. Or in hardware-timed bursts."""
        plan = parts[0].plan or self.shots(inputs)
        return still_pictures(
            bench,
            parts,
            plan=plan,
            probes=[shot.index for shot in plan if shot.kind is ShotKind.IMAGE][:PROBES],
            patterns=Patterns(inputs, bench.dmd.shape),
            drive=self.drive(bench, inputs),
            timebase=Timebase(self.sample_rate, self.sample_count(inputs)),
            averages=self.averages,
            timing=self.timing,
            longest_burst=self.longest_burst,
            apart_nm=min(np.diff(sorted(self.wavelengths)).tolist(), default=math.inf),
        )


def stills_start_s(bench: Bench, drive: Drive, window_s: float, timing: Timing) -> float:
    """How long after the trigger frames of still pictures begin, s.

    Raises:
        ProtocolError: in a burst they would last into the next picture.
    """
    return 0.0 if timing == "software" else frame_start_s(burst_dmd(bench), drive, window_s)


def stills_duration_s(passes: int, shots: int, averages: int, together: float) -> float:
    """How long still pictures take on real instruments, ranging included, s; in bursts of so many, loading too."""
    if together == math.inf:
        shot_s = REAL_SHOT_S if averages == 1 else REAL_MEAN_S
        return passes * (REAL_PASS_S + (shots + PROBES) * shot_s)
    bursts_s = shots * averages * REAL_PICTURE_S + math.ceil(shots / together) * REAL_BURST_S
    return shots * REAL_UPLOAD_S + passes * (REAL_PASS_S + PROBES * REAL_SHOT_S + bursts_s)


def still_pictures(
    bench: Bench,
    parts: Sequence[Part],
    *,
    plan: Sequence[Shot],
    probes: Sequence[int],
    patterns: Patterns,
    drive: Drive,
    timebase: Timebase,
    averages: int,
    timing: Timing,
    longest_burst: int | None = None,
    apart_nm: float = math.inf,
) -> Events:
    """Measure `parts` shot by shot (show, arm, wait for the marker of the running drive, read), or in bursts.

    plan: what of `patterns` each shot of the run shows. probes: indices of the shots that the ranges are found with.
    apart_nm: how far apart the closest wavelengths of the run are.

    Raises:
        ProtocolError: the laser settled so far from a wavelength that they would not be that far apart.
    """
    finer = 1
    if timing == "burst":
        dmd = burst_dmd(bench)
        memory = PictureMemory(bench, patterns, plan)
        finer = MEAN_FINER if averages > 1 and bench.scope.code_type == "int8" else 1
    dark = next((partial(show_and_capture, bench, patterns[shot]) for shot in plan if shot.kind is ShotKind.DARK), None)
    with bench.emitting(parts[0].pass_.wavelength_nm, parts[0].pass_.patching):
        for part in parts:
            pass_ = part.pass_
            settled_nm = bench.tune(pass_.wavelength_nm)
            if abs(settled_nm - pass_.wavelength_nm) > MOST_OFF * apart_nm:
                raise ProtocolError(
                    f"the laser settled at {settled_nm:.9g} nm, not at {pass_.wavelength_nm:.9g} nm, and wavelengths "
                    f"are {1e3 * apart_nm:.6g} pm apart: choose wavelengths, or a step, that this laser can make"
                )
            bench.connect(pass_.patching)
            bench.load_drive(drive)
            bench.play_drive()
            bench.configure(timebase, pass_.patching, 1 if timing == "burst" else averages)
            captures = [partial(show_and_capture, bench, patterns[plan[probe]]) for probe in probes]
            known = part.scalings and rescaled(part.scalings, finer)
            scalings = lock_ranges(bench, known, captures, dark)
            yield PassStarted(pass_, rescaled(scalings, 1 / finer))
            if timing == "burst":
                yield from measure_bursts(
                    bench,
                    dmd,
                    memory,
                    part,
                    drive,
                    timebase,
                    averages=averages,
                    finer=finer,
                    longest_burst=longest_burst,
                )
            else:
                for shot in part.shots:
                    yield Record(pass_, shot.index, show_and_capture(bench, patterns[plan[shot.index]]))


def pseudorandom_drive(bench: Bench, seed: int, *, repeats_after_s: float = DRIVE_SAMPLES / DRIVE_RATE) -> Drive:
    """Uniform pseudorandom samples at 25 GS/s, fixed by the seed, that repeat after a time; a period is 100 ns or more.

    A shorter period would have passed before the light of a drive that starts is through the fibre.
    """
    different = max(1, round(repeats_after_s * DRIVE_RATE))
    samples = np.random.default_rng((seed, 2)).uniform(-1.0, 1.0, different).astype(np.float32)
    period = np.tile(samples, -(-DRIVE_SAMPLES // different))
    return Drive("pseudorandom", period, DRIVE_RATE, bench.levels.rf_amplitude_vpp)


def show_and_capture(bench: Bench, mirrors: NDArray[np.uint8]) -> Frames:
    """Show one pattern and take one frame of every configured channel."""
    bench.show(mirrors)
    return bench.capture()


def balanced_order(labels: NDArray[np.int64], generator: np.random.Generator) -> NDArray[np.int64]:
    """A random permutation of 0..n-1 in which the classes alternate as evenly as their numbers allow, shape (n,)."""
    places = np.empty(labels.size)
    for label in np.unique(labels):
        members = np.flatnonzero(labels == label)
        # Each class is spread evenly over the unit interval, at random inside each of its equal slots.
        places[generator.permutation(members)] = (
            np.arange(members.size) + generator.random(members.size)
        ) / members.size
    return np.argsort(places, kind="stable")


def _shot(index: int, kind: ShotKind, images: Images, place: np.int64) -> Shot:
    source = int(images.indices[place])
    return Shot(index, kind, source, int(images.labels[place]), source)
