"""A bench in one's hands: show a picture, take a trace, set the laser; without a protocol and without a run."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from instruments.bench import Bench, Observer, Observers
from instruments.errors import LabctlError, NotConfigured, OutOfRange, SettingChanged
from instruments.safe_state import failing_with
from instruments.units import value_in
from instruments.values import Codes, Scaling, Timebase
from labctl.bench.identity import who_they_are
from labctl.bench.lock import held
from labctl.bench.opening import Access, opened
from labctl.bench.station import Station
from labctl.bench.supervision import supervised
from labctl.runs.format.origin import Origin
from labctl.runs.live.logs import CommandLog
from protocols.base import Images, Shot, ShotKind
from protocols.image_readout import LONGEST_WINDOW_S, SHORTEST_WINDOW_S, pseudorandom_drive
from protocols.patterns import Patterns
from protocols.ranging import find_ranges

SAMPLE_RATE = 25e9
TASK = "a bench in hand"


@dataclass(frozen=True)
class Traces:
    """What the oscilloscope showed at one trigger.

    volts: (ports, samples) V. time_s: (samples,) s after the trigger. ports: of each row. clipped: (ports,) whether a
    trace touches the end of its vertical range. codes: (ports, samples) as the oscilloscope gave them. scalings: what
    a code of each port means. origin: whether the bench is a simulated one.
    """

    volts: NDArray[np.float64]
    time_s: NDArray[np.float64]
    ports: tuple[int, ...]
    clipped: NDArray[np.bool_]
    codes: Codes
    scalings: tuple[Scaling, ...]
    origin: Origin


class HandLaser:
    """The laser of a bench in one's hands."""

    def __init__(self, held: Callable[[], Bench], wavelength_nm: float, dark: Callable[[], None]) -> None:
        """Nothing is sent yet. `held` gives the bench, or refuses; `dark` makes it safe where the laser fails."""
        self._held = held
        self._dark = dark
        self.wavelength_nm = wavelength_nm

    @property
    def power(self) -> float:
        """Optical power that it is set to, W. Set it in W or as text, "3 mW" or "5 dBm".

        Raises:
            LabctlError: the bench is closed; so says whatever is asked of it then.
            ValueError: the text is no power.
            OutOfRange: above the limit of the station, or outside the laser's range; nothing was sent then.
            InstrumentError: the laser failed, or gives more than the limit; the bench is dark.
        """
        return self._held().levels.optical_power_w

    @power.setter
    def power(self, power: float | str) -> None:
        bench = self._held()
        power_w = value_in(power, "W")
        levels = replace(bench.levels, optical_power_w=power_w)
        bench.limits.check_levels(levels, bench.source)
        if bench.lit:
            try:
                settled_w = bench.laser.set_power(power_w)
                bench.observer.event("power set", power_w=settled_w)
                bench.limits.check_power(settled_w)
            except OutOfRange:  # nothing was sent: the light is what it was
                raise
            except BaseException:
                with failing_with(self._dark):
                    raise
        bench.levels = levels

    @property
    def wavelength(self) -> float:
        """Wavelength that it is set to, nm. Set it in nm or as text, "1550 nm".

        Raises:
            ValueError: the text is no wavelength.
            OutOfRange: outside the tuning range; the bench is dark.
            InstrumentError: the laser, or what is behind it, failed; the bench is dark.
        """
        self._held()
        return self.wavelength_nm

    @wavelength.setter
    def wavelength(self, wavelength: float | str) -> None:
        bench = self._held()
        wavelength_nm = value_in(wavelength, "nm")
        with failing_with(self._dark):
            self.wavelength_nm = bench.tune(wavelength_nm) if bench.lit else wavelength_nm


class Hands:
    """An opened bench. Light comes on with the first `capture`; leaving the context, however, makes the bench dark.

    It is closed then: whatever is asked of it is a `LabctlError`, and nothing is sent, since others may have the bench.

    Attributes:
        laser: power and wavelength.
        origin: whether its instruments are simulated ones.
    """

    def __init__(self, bench: Bench, *, origin: Origin, wavelength_nm: float, drive_seed: int) -> None:
        """Not for callers: `labctl.bench` opens one."""
        self.laser = HandLaser(self._held, wavelength_nm, self.dark)
        self.origin = origin
        self._bench: Bench | None = bench  # until the block ends
        self._drive = pseudorandom_drive(bench, drive_seed)
        self._plays = True
        self._shown: NDArray[np.uint8] | None = None  # by the mirrors, while there is light
        self._blanked = False  # since then, by the safe state
        self._light = ExitStack()
        self._configured: tuple[tuple[int, ...], int, int, float] | None = None
        self._scalings: tuple[Scaling, ...] = ()

    def show(self, image: ArrayLike) -> None:
        """Show an image on the mirrors, as large as they allow: (rows, columns), on where it is above one half.

        Raises:
            OutOfRange: it has no two dimensions, or no pixel.
            ProtocolError: it has more pixels than there are mirrors.
            InstrumentError: the mirrors failed; the bench is dark.
        """
        bench = self._held()
        pixels = np.asarray(image) > 0.5
        if pixels.ndim != 2 or not pixels.size:
            raise OutOfRange(f"an image of shape {pixels.shape}: show one of rows and columns")
        patterns = Patterns(Images(pixels[np.newaxis], np.zeros(1, np.int64), np.zeros(1, np.int64)), bench.dmd.shape)
        self._shown = patterns[Shot(0, ShotKind.IMAGE, 0, 0, 0)]
        with failing_with(self.dark):
            self._show(bench)

    def blank(self) -> None:
        """Turn every mirror away; the light stays on.

        Raises:
            InstrumentError: the mirrors failed; the bench is dark.
        """
        bench = self._held()
        self._shown = None
        with failing_with(self.dark):
            bench.dmd.blank()

    def capture(self, *, window: float | str = 2e-9, ports: Sequence[int] = (2, 3, 4, 5), averages: int = 1) -> Traces:
        """Traces of some ports, as many as the oscilloscope has channels; switches the light on if it is off.

        The vertical ranges are found anew where window, ports, averages or power are others than before.

        Args:
            window: Length of a trace, s, or text such as "2 ns".
            ports: Waveguides of the chip, or 0 alone, the fibre before it.
            averages: Triggers that the trace is the mean of.

        Raises:
            ValueError: the text of `window` is no time.
            NotConfigured: the laser is not armed, or the drive is off.
            OutOfRange: more ports than channels, 0 among others, or no such window.
            InstrumentError: an instrument failed; the bench is dark.
        """
        bench = self._held()
        window_s = value_in(window, "s")
        if not SHORTEST_WINDOW_S <= window_s <= LONGEST_WINDOW_S:
            raise OutOfRange(f"window = {window_s:g} s: choose {SHORTEST_WINDOW_S:g} to {LONGEST_WINDOW_S:g} s")
        patchings = bench.patchings_for(tuple(ports))
        if len(patchings) != 1:
            raise OutOfRange(
                f"{len(ports)} ports at once: the bench has {len(bench.wiring.channels)} channels, and port 0 is "
                f"measured alone, since its fibre does not go into the chip then: name fewer"
            )
        if not self._plays:
            raise NotConfigured("the drive is off, and the oscilloscope is triggered by its marker: switch it on")
        samples = max(1, round(window_s * SAMPLE_RATE))
        asked = tuple(patchings[0].values()), samples, averages, self.laser.power
        with failing_with(self.dark), bench.explained():
            if not bench.lit:
                self._switch_on(bench, patchings[0])
            if self._configured != asked:
                bench.connect(patchings[0])
                bench.configure(Timebase(SAMPLE_RATE, samples), patchings[0], averages)
                self._scalings = find_ranges(bench, [bench.capture])
                self._configured = asked
            bench.observer.while_lit()
            frames = bench.capture()
            bench.laser.require_emission()
            bench.limits.check_traces(tuple(patchings[0]), frames.codes, self._scalings)
        volts = [one.scale_v * codes + one.offset_v for one, codes in zip(self._scalings, frames.codes[0], strict=True)]
        return Traces(
            np.array(volts),
            np.arange(samples) / SAMPLE_RATE,
            asked[0],
            frames.clipped[0],
            frames.codes[0],
            self._scalings,
            self.origin,
        )

    def find_ranges(self) -> None:
        """Have the next `capture` find the vertical ranges anew."""
        self._configured = None

    def require_unchanged(self) -> None:
        """Compare powers with their limits, and the instruments with what they were set to, while there is light.

        Raises:
            SettingChanged: something was changed from elsewhere; the next `capture` finds the vertical ranges anew.
            OverLimit: too much light; the bench is dark.
            InstrumentError: an instrument failed; the bench is dark.
        """
        bench = self._held()
        try:
            if bench.lit:
                bench.require_unchanged()
        except SettingChanged:
            self.find_ranges()
            raise
        except BaseException:
            with failing_with(self.dark):
                raise

    def require_supervision(self) -> None:
        """Nothing but that the supervisor is there while there is light; `capture` requires it too.

        Raises:
            UnsafeBench: it has ended, or its copy; the bench is dark.
        """
        bench = self._held()
        if bench.lit:
            with failing_with(self.dark):
                bench.observer.while_lit()

    @property
    def drive(self) -> bool:
        """Whether the drive plays while there is light. Without it the oscilloscope has no trigger.

        Raises:
            InstrumentError: the AWG failed; the bench is dark.
        """
        self._held()
        return self._plays

    @drive.setter
    def drive(self, plays: bool) -> None:
        bench = self._held()
        if bench.lit and plays != self._plays:
            with failing_with(self.dark):
                if plays:
                    bench.play_drive()
                else:
                    bench.stop_drive()
        self._plays = plays

    def dark(self) -> None:
        """Reach the safe state now; the next `capture` shows again what was shown, and switches the light on.

        Raises:
            UnsafeBench: an instrument did not obey.
        """
        self._held()
        self._configured = None
        self._blanked = True
        self._light.close()

    def _held(self) -> Bench:
        """The bench, while it is this one's."""
        if self._bench is None:
            raise LabctlError(
                "this bench is closed since its block ended, nothing was sent: open it again: "
                "with labctl.bench(...) as bench:"
            )
        return self._bench

    def _show(self, bench: Bench) -> None:
        if self._shown is not None:
            bench.show(self._shown)
            self._blanked = False

    def _switch_on(self, bench: Bench, patching: Mapping[int, int]) -> None:
        if self._blanked:
            self._show(bench)
        self._light.enter_context(bench.emitting(self.laser.wavelength_nm, patching))
        bench.load_drive(self._drive)
        bench.play_drive()

    def __enter__(self) -> Self:
        """Itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """The safe state; the bench is closed."""
        self._bench = None
        self._light.__exit__(kind, error, trace)


@contextmanager
def in_hands(
    station: Station,
    access: Access,
    *,
    wavelength_nm: float,
    drive_seed: int,
    observer: Observer | None = None,
    task: str = TASK,
    directory: Callable[[Origin], Path] | None = None,
) -> Iterator[Hands]:
    """The bench of `station`, held for a `task` and supervised; dark when the block ends, however it does.

    Every instrument is asked who it is before there is light. `directory` makes a folder for logs; it is asked for one
    when the bench is held and may be lit.

    Raises:
        StationError, OutOfRange: the station is wrong.
        BenchInUse: another process has an instrument.
        InstrumentError: an instrument does not answer, or is another than its driver is for.
        NotConfigured: with `directory`, the laser is not armed.
    """
    observers = Observers()
    with ExitStack() as stack:
        log = stack.enter_context(CommandLog())
        hold = stack.enter_context(held(station, task, access.wire))
        supervisor = stack.enter_context(supervised(station, log, access.wire, hold.descriptors))
        for one in (hold, supervisor, log, observer or Observer()):
            observers.add(one)
        bench = stack.enter_context(opened(station, log, access, observer=observers)).bench
        if directory is not None:
            bench.require_arm()
        origin = _origin(station, bench)
        if directory is not None:
            observers.stored_in(directory(origin))
        yield stack.enter_context(Hands(bench, origin=origin, wavelength_nm=wavelength_nm, drive_seed=drive_seed))


def _origin(station: Station, bench: Bench) -> Origin:
    instruments = {name: {"identity": vars(identity)} for name, identity in who_they_are(station, bench).items()}
    return Origin.of({"station": station.model_dump(mode="json"), "instruments": instruments})
