"""A protocol of one's own."""

from collections.abc import Sequence
from functools import partial
from typing import Annotated, ClassVar

from pydantic import Field, PositiveInt

from instruments.bench import Bench
from instruments.units import Seconds
from instruments.values import Drive, Timebase
from protocols.base import Events, Images, Measurement, Part, Pass, PassStarted, Record, Shot, ShotKind
from protocols.image_readout import pseudorandom_drive, show_and_capture
from protocols.patterns import Patterns
from protocols.ranging import lock_ranges
from protocols.settings import Binarisation, Classes, Ports, passes_for, samples_in


class Repeatability(Measurement[Images]):
    """Show one image again and again: how much its traces differ is noise and drift."""

    name: ClassVar[str] = "repeatability"

    dataset: str = "mnist-0-3"
    classes: Classes | None = (0,)
    images: PositiveInt = 1
    binarisation: Binarisation = "128"
    ports: Ports = (2, 3, 4, 5)
    window: Annotated[Seconds, Field(gt=0)] = 2e-9
    repeats: PositiveInt = 100

    def shots(self, inputs: Images) -> Sequence[Shot]:
        """Every repeat of an image is of the image's group: data are never split between them."""
        source, label = int(inputs.indices[0]), int(inputs.labels[0])
        return [Shot(index, ShotKind.IMAGE, source, label, group=source) for index in range(self.repeats)]

    def passes(self, bench: Bench) -> tuple[Pass, ...]:
        """As many patchings as the ports need on this bench."""
        return passes_for(bench, (1550.0,), self.ports)

    def check(self, bench: Bench, inputs: Images) -> None:
        """The image must fit the DMD."""
        Patterns(inputs, bench.dmd.shape)

    def drive(self, bench: Bench, inputs: Images) -> Drive:
        """The pseudorandom drive of an image readout."""
        return pseudorandom_drive(bench, self.seed)

    def sample_count(self, inputs: Images) -> int:
        """The window in samples."""
        return samples_in("window", self.window, self.sample_rate)

    def duration_s(self, bench: Bench, shots: int) -> float:
        """Twenty shots a second on real instruments."""
        return len(self.passes(bench)) * shots / 20

    def acquire(self, bench: Bench, inputs: Images, parts: Sequence[Part]) -> Events:
        """For each pass: patch, load, find the ranges; then a record a shot."""
        patterns = Patterns(inputs, bench.dmd.shape)
        drive = self.drive(bench, inputs)
        timebase = Timebase(self.sample_rate, self.sample_count(inputs))
        with bench.emitting(parts[0].pass_.wavelength_nm, parts[0].pass_.patching):
            for part in parts:
                bench.connect(part.pass_.patching)
                bench.load_drive(drive)
                bench.play_drive()
                bench.configure(timebase, part.pass_.patching, self.averages)
                mirrors = patterns[part.shots[0]]
                probe = partial(show_and_capture, bench, mirrors)
                yield PassStarted(part.pass_, lock_ranges(bench, part.scalings, [probe]))
                for shot in part.shots:
                    yield Record(part.pass_, shot.index, show_and_capture(bench, mirrors))
