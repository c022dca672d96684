"""A driver and a protocol of one's own, as a package beside labctl."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Annotated, ClassVar

from pydantic import Field, PositiveInt

from instruments.bench import Bench
from instruments.errors import InstrumentError, OutOfRange
from instruments.interfaces import PatchPanel
from instruments.units import Seconds
from instruments.values import Drive, Identity, Timebase
from instruments.visa import VisaLink
from labctl.bench.drivers import Opening
from labctl.bench.station import PatchPanelSection
from protocols.base import Events, Images, Measurement, Part, Pass, PassStarted, Record, Shot, ShotKind
from protocols.image_readout import pseudorandom_drive, show_and_capture
from protocols.patterns import Patterns
from protocols.ranging import lock_ranges
from protocols.settings import Binarisation, Classes, Ports, passes_for


class ListSwitch(PatchPanel):
    """An optical switch that takes all its routes in one message, `ROUTe:CLOSe (@1!2,2!3)`."""

    def __init__(self, link: VisaLink, *, ports: tuple[int, ...]) -> None:
        """Drive the switch behind `link`, which carries `ports`."""
        self._link = link
        self.ports = ports

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def self_test(self) -> None:
        """Read the routes; the error queue is read at the end of the block."""
        with self._link.checked():
            self._link.query("ROUTe:CLOSe?")

    def connect(self, patching: Mapping[int, int]) -> None:
        """Open every route, close the wanted ones, and compare with what the switch says."""
        for port in patching.values():
            if port not in self.ports:
                raise OutOfRange(f"port {port} is not wired to the switch (ports {list(self.ports)})")
        wanted = "(@" + ",".join(f"{channel}!{port}" for channel, port in sorted(patching.items())) + ")"
        with self._link.checked():
            self._link.write("ROUTe:OPEN:ALL")
            self._link.write(f"ROUTe:CLOSe {wanted}")
            self._link.query("*OPC?")
        routed = self._link.query("ROUTe:CLOSe?")
        if routed != wanted:
            raise InstrumentError(f"patch_panel: routes are {routed}, wanted {wanted}: check the switch")

    def settings(self) -> dict[str, str | float]:
        """The closed routes, for the manifest."""
        return {"routes": self._link.query("ROUTe:CLOSe?")}

    def make_safe(self) -> None:
        """A route carries light only while the laser emits."""

    def close(self) -> None:
        """Close the link."""
        self._link.close()


def list_switch(section: PatchPanelSection, opening: Opening) -> PatchPanel:
    """What the entry point names: from the section of the station file to the instrument."""
    link = VisaLink(opening.address, name="patch_panel", timeout_s=section.timeout, transcript=opening.transcript)
    return ListSwitch(link, ports=section.ports)


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
        return max(1, round(self.window * self.sample_rate))

    def duration_s(self, bench: Bench, shots: int) -> float:
        """Twenty shots a second on real instruments."""
        return len(self.passes(bench)) * shots / 20

    def acquire(self, bench: Bench, inputs: Images, parts: Sequence[Part]) -> Events:
        """For each pass: patch, load, find the ranges; then a record a shot."""
        patterns = Patterns(inputs, bench.dmd.shape)
        drive = self.drive(bench, inputs)
        timebase = Timebase(self.sample_rate, self.sample_count(inputs))
        with bench.emitting(parts[0].pass_.wavelength_nm):
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
