"""Scenes that change while they are watched: the drive repeats, the DMD switches images at a commanded instant."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt, field_validator

from instruments.bench import Bench
from instruments.interfaces import BurstDmd, Dmd
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
from protocols.bursts import SETTLED_PERIODS, burst_dmd, load_pictures, played
from protocols.image_readout import DRIVE_RATE, DRIVE_SAMPLES, pseudorandom_drive
from protocols.means import averaged, rescaled
from protocols.patterns import Patterns
from protocols.ranging import lock_ranges
from protocols.reference_picture import beside_reference, field_of
from protocols.settings import Binarisation, Classes, ImageCount, Pair, Ports, Wavelengths, passes_for, samples_in

PULSE_STEP_S = 1e-6
"""The DMD's pulse lasts whole microseconds."""
REAL_SCENE_S = 1.5
"""One scene on real instruments: FastFrame takes 400 ms to be ready, four long transfers about 1 s."""

MOST_SUMMED = 255
"""Records of 8 bits whose sum fits 16 bits."""


class DynamicScene(Measurement[Images]):
    """Show one image, switch to another while a single long record is taken, on every port.

    The scenes begin with images of the first class and end with images of the second, drawn by the seed from the same
    `images` that an image readout with this seed shows. The AWG starts at the end of the DMD's pulse and plays one
    period of the drive after another; the record begins some whole periods later, `switch_after` before the switch is
    commanded: windows at whole periods of it see the masks of an image readout with the same seed. With `reference`
    the middle of the images is shown beside the reference of ghost imaging, and `repeats_after` is the time after which
    the drive repeats: so windows see the masks of ghost imaging with that window and the same seed.
    """

    name: ClassVar[str] = "dynamic-scene"
    judgement: ClassVar[Judgement] = Judgement.EXPERIMENT
    added_settings: ClassVar[frozenset[str]] = frozenset({"reference", "repeats_after"})

    averages: Annotated[int, Field(ge=1, le=MOST_SUMMED)] = 1
    dataset: str = "mnist-0-3"
    classes: Classes | None = None
    images: ImageCount = 1000
    binarisation: Binarisation = "128"
    switch: Pair = (1, 2)
    scenes: PositiveInt = 3
    ports: Ports = (2, 3, 4, 5, 6)
    wavelengths: Wavelengths = (1550.0,)
    switch_after: Annotated[Seconds, Field(gt=0, le=20e-6)] = 4.6e-6
    window: Annotated[Seconds, Field(ge=40e-12, le=20e-6)] = 10e-6
    reference: bool = False
    repeats_after: Annotated[Seconds, Field(ge=40e-12, le=20e-6)] = DRIVE_SAMPLES / DRIVE_RATE

    @field_validator("switch")
    @classmethod
    def _different(cls, switch: tuple[int, int]) -> tuple[int, int]:
        if switch[0] == switch[1]:
            raise ValueError(f"{switch}: nothing would be seen to change: name two classes")
        return switch

    def shots(self, inputs: Images) -> Sequence[Shot]:
        """One shot a scene, of an image of the first class and what it changes to.

        Raises:
            ProtocolError: too few images of a class.
        """
        before, after = (self._drawn(inputs, label, draw) for draw, label in enumerate(self.switch))
        return [
            Shot(
                place,
                ShotKind.SCENE,
                int(inputs.indices[first]),
                self.switch[0],
                int(inputs.indices[first]),
                next_dataset_index=int(inputs.indices[second]),
                next_label=self.switch[1],
            )
            for place, (first, second) in enumerate(zip(before, after, strict=True))
        ]

    def passes(self, bench: Bench) -> tuple[Pass, ...]:
        """Every wavelength with every patching that the ports need."""
        return passes_for(bench, self.wavelengths, self.ports)

    def check(self, bench: Bench, inputs: Images) -> None:
        """The DMD must switch when it is asked to, and the images fit it."""
        self.start_s(bench, inputs)
        self._patterns(inputs, bench.dmd)

    def check_cabling(self, bench: Bench) -> None:
        """As of every protocol, and the DMD must start the AWG."""
        super().check_cabling(bench)
        burst_dmd(bench)

    def drive(self, bench: Bench, inputs: Images) -> Drive:
        """The pseudorandom drive of an image readout with the same seed, or of ghost imaging."""
        return pseudorandom_drive(bench, self.seeds.drive, repeats_after_s=self.repeats_after)

    def sample_count(self, inputs: Images) -> int:
        """The window in samples of 40 ps."""
        return samples_in("window", self.window, self.sample_rate)

    def start_s(self, bench: Bench, inputs: Images) -> float:
        """After the periods of the drive that lead."""
        return self._lead_s(burst_dmd(bench), self.drive(bench, inputs))

    def duration_s(self, bench: Bench, shots: int) -> float:
        """Every scene `averages` times and once to find the ranges, pass by pass."""
        return len(self.passes(bench)) * shots * (self.averages + 1) * REAL_SCENE_S

    def acquire(self, bench: Bench, inputs: Images, parts: Sequence[Part]) -> Events:
        """Scene by scene: arm, let the DMD play both images, read; `averages` times."""
        dmd = burst_dmd(bench)
        plan = parts[0].plan or self.shots(inputs)
        patterns = self._patterns(inputs, dmd)
        drive = self.drive(bench, inputs)
        lead_s = self.start_s(bench, inputs)
        timebase = Timebase(self.sample_rate, self.sample_count(inputs), lead_s)
        load_pictures(bench, [patterns.block(_pictures(shot)) for shot in plan], 2 * len(plan))
        with bench.emitting(parts[0].pass_.wavelength_nm, parts[0].pass_.patching):
            bench.load_drive(drive, periods_per_trigger=math.inf)
            for part in parts:
                bench.tune(part.pass_.wavelength_nm)
                bench.connect(part.pass_.patching)
                bench.configure(timebase, part.pass_.patching)
                captures = [partial(self._capture, bench, dmd, shot, lead_s) for shot in plan]
                finer = self.averages if bench.scope.code_type == "int8" else 1
                known = part.scalings and rescaled(part.scalings, finer)
                scalings = lock_ranges(bench, known, captures)
                yield PassStarted(part.pass_, rescaled(scalings, 1 / finer))
                for shot in part.shots:
                    playings = [captures[shot.index]() for _ in range(self.averages)]
                    yield Record(part.pass_, shot.index, averaged(playings, finer))

    def _patterns(self, inputs: Images, dmd: Dmd) -> Patterns:
        if not self.reference:
            return Patterns(inputs, dmd.shape)
        return Patterns(replace(inputs, images=beside_reference(field_of(inputs.images), reference=True)), dmd.shape)

    def _lead_s(self, dmd: BurstDmd, drive: Drive) -> float:
        """How long the drive plays before the record begins: so that the DMD's pulse, at whose end it starts, is whole.

        Raises:
            ProtocolError: no such pulse has the switch at `switch_after`.
        """
        settled_s = SETTLED_PERIODS * drive.period_s
        left_s = dmd.picture_period_s - self.switch_after - settled_s
        repeats_s = samples_in("repeats_after", self.repeats_after, DRIVE_RATE) / DRIVE_RATE
        pulses_s = left_s - repeats_s * np.arange(math.ceil(left_s / repeats_s))
        pulses_s = pulses_s[pulses_s > PULSE_STEP_S / 2]
        if not pulses_s.size:
            raise ProtocolError(
                f"switch_after = {self.switch_after * 1e6:g} us: the drive plays for {settled_s * 1e6:g} us before the "
                f"record, and a picture lasts {dmd.picture_period_s * 1e6:g} us: choose a shorter one, or repeats_after"
            )
        off_s = pulses_s - PULSE_STEP_S * np.rint(pulses_s / PULSE_STEP_S)
        best = int(np.argmin(np.round(np.abs(off_s), 12)))
        if abs(off_s[best]) > 0.5 / self.sample_rate:
            raise ProtocolError(
                f"switch_after = {self.switch_after * 1e6:g} us: with a DMD's pulse of whole us and a drive that "
                f"repeats after {repeats_s * 1e9:g} ns the switch comes at {(self.switch_after + off_s[best]) * 1e6:g} "
                f"us: choose that"
            )
        return settled_s + best * repeats_s

    def _capture(self, bench: Bench, dmd: BurstDmd, scene: Shot, lead_s: float) -> Frames:
        """One playing of a scene: the pulse that starts the AWG ends so long before the second image comes."""
        dmd.hold()
        bench.stop_drive()
        bench.play_drive()
        period_s = dmd.picture_period_s
        pulse_s = period_s - lead_s - self.switch_after
        return played(bench, 1, partial(dmd.play, 2 * scene.index, 2, period_s, pulse_s=pulse_s))

    def _drawn(self, inputs: Images, label: int, draw: int) -> NDArray[np.intp]:
        members = np.flatnonzero(inputs.labels == label)
        if members.size < self.scenes:
            raise ProtocolError(
                f"{self.dataset}: {members.size} images of class {label} for {self.scenes} scenes: ask for fewer scenes"
            )
        return np.random.default_rng((self.seeds.order, 3, draw)).choice(members, self.scenes, replace=False)


def _pictures(scene: Shot) -> tuple[Shot, Shot]:
    """What the DMD shows first and then."""
    return scene, replace(scene, dataset_index=scene.next_dataset_index)
