"""Calibration and unseen images for ghost imaging: random patterns and images, each beside a reference and alone."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from instruments.bench import Bench
from instruments.units import Seconds
from instruments.values import Drive, Timebase
from protocols.base import Events, Images, Judgement, Measurement, Part, Pass, ProtocolError, Shot, ShotKind
from protocols.bursts import burst_dmd, shots_a_burst
from protocols.image_readout import (
    LONGEST_WINDOW_S,
    PROBES,
    SHORTEST_WINDOW_S,
    Timing,
    pseudorandom_drive,
    still_pictures,
    stills_duration_s,
    stills_start_s,
)
from protocols.patterns import Patterns
from protocols.reference_picture import BORDER, beside_reference, field_of, random_patterns
from protocols.settings import Binarisation, Classes, ImageCount, Ports, Wavelengths, passes_for, samples_in

BESIDE = (ShotKind.PATTERN, ShotKind.IMAGE, ShotKind.REFERENCE)
"""Shots with the reference on."""
ALONE = {ShotKind.PATTERN: ShotKind.PATTERN_ALONE, ShotKind.IMAGE: ShotKind.IMAGE_ALONE}


class GhostImaging(Measurement[Images]):
    """Show random patterns and images in the middle of the mirrors, each beside the reference border and without it.

    The patterns calibrate, the images are unseen. The drive repeats after the window, so that windows which follow each
    other see the same masks. Patterns and images come in random order; the reference alone and a dark frame follow
    every `reference_every` of them. A pattern's `group` is its number in `patterns_of`.
    """

    name: ClassVar[str] = "ghost-imaging"
    judgement: ClassVar[Judgement] = Judgement.EXPERIMENT

    dataset: str = "mnist-0-3"
    classes: Classes | None = None
    images: ImageCount = 100
    patterns: Annotated[int, Field(ge=2, le=100_000)] = 500
    binarisation: Binarisation = "128"
    ports: Ports = (2, 3, 4, 5, 6)
    window: Annotated[Seconds, Field(ge=SHORTEST_WINDOW_S, le=LONGEST_WINDOW_S)] = 10e-9
    wavelengths: Wavelengths = (1550.0,)
    timing: Timing = "software"
    reference_every: Annotated[int, Field(ge=1, le=1_000_000)] = 20

    def patterns_of(self, inputs: Images) -> NDArray[np.bool_]:
        """The random patterns, as large as the part of the images that is shown."""
        rows, columns = field_of(inputs.images).shape[1:]
        return random_patterns(self.seeds.images, self.patterns, (rows, columns))

    def shots(self, inputs: Images) -> Sequence[Shot]:
        """Patterns and images in random order, each beside the reference and then alone."""
        images = zip(inputs.indices.tolist(), inputs.labels.tolist(), strict=True)
        shown = [Shot(0, ShotKind.PATTERN, -1, -1, number) for number in range(self.patterns)]
        shown += [Shot(0, ShotKind.IMAGE, index, label, index) for index, label in images]
        shots: list[Shot] = []
        for place, row in enumerate(np.random.default_rng((self.seeds.order, 1)).permutation(len(shown)), start=1):
            shots += (shown[row], replace(shown[row], kind=ALONE[shown[row].kind]))
            if place % self.reference_every == 0 or place == len(shown):
                shots += (Shot(0, ShotKind.REFERENCE, -1, -1, -1), Shot(0, ShotKind.DARK, -1, -1, -1))
        return [replace(shot, index=place) for place, shot in enumerate(shots)]

    def passes(self, bench: Bench) -> tuple[Pass, ...]:
        """Every wavelength with every patching that the ports need."""
        return passes_for(bench, self.wavelengths, self.ports)

    def check(self, bench: Bench, inputs: Images) -> None:
        """The images must be larger than the border, the pictures fit the DMD, and a frame of a burst its picture."""
        self.start_s(bench, inputs)
        rows, columns = inputs.images.shape[1:]
        if min(rows, columns) <= 2 * BORDER:
            raise ProtocolError(
                f"{self.dataset}: images of {rows}x{columns} pixels lie under the reference, a border of {BORDER}: "
                f"use larger images"
            )
        Patterns(self._pictures(inputs, self.shots(inputs)[:1]), bench.dmd.shape)

    def check_cabling(self, bench: Bench) -> None:
        """As of every protocol, and bursts need cables of their own."""
        super().check_cabling(bench)
        if self.timing == "burst":
            burst_dmd(bench)

    def drive(self, bench: Bench, inputs: Images) -> Drive:
        """Uniform pseudorandom samples at 25 GS/s, fixed by the seed; they repeat after the window."""
        return pseudorandom_drive(bench, self.seeds.drive, repeats_after_s=self.window)

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
        return shots_a_burst(self.averages, None) if self.timing == "burst" else math.inf

    def acquire(self, bench: Bench, inputs: Images, parts: Sequence[Part]) -> Events:
        """Shot by shot or in hardware-timed bursts, as an image readout."""
        plan = parts[0].plan or self.shots(inputs)
        pictures = self._pictures(inputs, plan)
        return still_pictures(
            bench,
            parts,
            plan=[replace(shot, dataset_index=shot.index) for shot in plan],
            probes=[shot.index for shot in plan if shot.kind in BESIDE][:PROBES],
            patterns=Patterns(pictures, bench.dmd.shape),
            drive=self.drive(bench, inputs),
            timebase=Timebase(self.sample_rate, self.sample_count(inputs)),
            averages=self.averages,
            timing=self.timing,
        )

    def _pictures(self, inputs: Images, shots: Sequence[Shot]) -> Images:
        """What the mirrors show at each of `shots`: pictures with the shots' indices."""
        images, patterns = field_of(inputs.images), self.patterns_of(inputs)
        fields = np.zeros((len(shots), *images.shape[1:]), np.bool_)
        for field, shot in zip(fields, shots, strict=True):
            if shot.kind in (ShotKind.PATTERN, ShotKind.PATTERN_ALONE):
                field[:] = patterns[shot.group]
            elif shot.dataset_index in inputs.places:
                field[:] = images[inputs.places[shot.dataset_index]]
        reference = np.array([shot.kind in BESIDE for shot in shots])
        indices = np.array([shot.index for shot in shots])
        return Images(beside_reference(fields, reference=reference), np.zeros_like(indices), indices)
