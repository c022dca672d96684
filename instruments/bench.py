"""The bench: five opened instruments with their wiring and limits, and the safe state they must always end in."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial

from instruments.errors import InstrumentError, LinkError, NotConfigured, OutOfRange
from instruments.interfaces import BYPASS_PORT, Awg, Dmd, Instrument, Oscilloscope, PatchPanel, TunableLaser
from instruments.limits import Levels, Limits
from instruments.values import Drive, EdgeTrigger, Uploading


@dataclass(frozen=True)
class Wiring:
    """How the instruments are cabled.

    trigger: what triggers the oscilloscope. channels: its channels that carry detectors. bypass: the collection fibre
    goes to a detector instead of into the chip. burst: DMD frame sync to AWG trigger, AWG marker to oscilloscope.
    projector: multimode fibre and DMD are in the light's way.
    """

    trigger: EdgeTrigger
    channels: tuple[int, ...]
    bypass: bool
    burst: bool
    projector: bool


@dataclass(frozen=True)
class Light:
    """What the laser settled on, by its own read-back."""

    wavelength_nm: float
    power_w: float


class UnsafeBench(InstrumentError):
    """The safe state could not be confirmed; the message names every instrument that did not obey.

    Attributes:
        disobeyed: those instruments, by their names in the bench; none where there was no light.
    """

    def __init__(self, message: str, disobeyed: Iterable[str] = ()) -> None:
        """Of the instruments `disobeyed`."""
        super().__init__(message)
        self.disobeyed = frozenset(disobeyed)


@dataclass
class Bench:
    """The opened instruments of a station.

    `armed` says that a person has allowed light. `source` is the file that describes it, for messages. `now` gives the
    time of the bench in seconds: the wall clock of a real bench, the virtual clock of a simulated one. `undisturbed`
    keeps what would stop the program out of the way into the safe state. `uploading` is called while a waveform or
    pictures go up. `before_light` is called whenever light is about to be switched on, and may refuse it by an
    `InstrumentError`. `lit` says that it was, and that the way into the safe state was not gone to its end since;
    `left_lit` that it was, and that the laser did not obey there.
    """

    awg: Awg
    scope: Oscilloscope
    laser: TunableLaser
    dmd: Dmd
    patch_panel: PatchPanel
    levels: Levels
    limits: Limits
    wiring: Wiring
    armed: bool
    source: str
    now: Callable[[], float]
    undisturbed: Callable[[], AbstractContextManager[None]] = nullcontext
    uploading: Uploading = lambda _what, _done, _total: None
    before_light: Callable[[], None] = lambda: None
    lit: bool = field(default=False, init=False)
    left_lit: bool = field(default=False, init=False)

    @property
    def instruments(self) -> dict[str, Instrument]:
        """The instruments by name, in the order of the safe state where it has one."""
        return {
            "laser": self.laser,
            "awg": self.awg,
            "dmd": self.dmd,
            "scope": self.scope,
            "patch_panel": self.patch_panel,
        }

    def __post_init__(self) -> None:
        """Compare the levels with the limits and with what the AWG can give, before anything can be sent.

        Raises:
            OutOfRange: the optical power or the RF amplitude exceeds its limit, or the AWG does not give it.
        """
        self.limits.check_levels(self.levels, self.source)
        self.awg.amplitude.check(f"{self.source}: awg.amplitude", self.levels.rf_amplitude_vpp)

    def require_arm(self) -> None:
        """Refuse light that nobody has allowed.

        Raises:
            NotConfigured: the bench is not armed.
        """
        if not self.armed:
            raise NotConfigured(
                f"{self.source}: the laser is not armed, no light is switched on: write armed = true under [laser] of "
                f"the station file, or repeat with --arm"
            )

    def patchings_for(self, ports: Sequence[int]) -> tuple[dict[int, int], ...]:
        """Distribute `ports` over the oscilloscope's channels: one patching (channel -> port) per pass.

        Where the chip is bypassed there is one fibre to measure, whatever ports are asked for.

        Raises:
            OutOfRange: a port that the patch panel does not carry.
        """
        if self.wiring.bypass:
            return ({self.wiring.channels[0]: BYPASS_PORT},)
        missing = [port for port in ports if port not in self.patch_panel.ports]
        if missing:
            raise OutOfRange(
                f"{self.source}: port {missing[0]} is not patched (patch_panel.ports = "
                f"{list(self.patch_panel.ports)}): choose other ports, or wire it and add it there"
            )
        width = len(self.wiring.channels)
        return tuple(
            dict(zip(self.wiring.channels, ports[first : first + width], strict=False))
            for first in range(0, len(ports), width)
        )

    def set_light(self, wavelength_nm: float) -> Light:
        """Set power and wavelength without switching the laser on; returns what it settled on.

        Raises:
            OutOfRange: outside the laser's range.
            OverLimit: by its own answer, it gives more than the limit.
            InstrumentError: it does not settle there.
        """
        power_w = self.laser.set_power(self.levels.optical_power_w)
        self.limits.check_power(power_w)
        return Light(wavelength_nm=self.laser.tune(wavelength_nm), power_w=power_w)

    @contextmanager
    def emitting(self, wavelength_nm: float) -> Iterator[None]:
        """The only way to light: emission inside the block, the safe state however it ends.

        Raises:
            NotConfigured: the bench is not armed; nothing was sent.
            OverLimit: by its own answer, the laser gives more than the limit.
            UnsafeBench: an instrument did not obey. Where the block fails, this is a note to its error.
        """
        self.require_arm()
        with ending_with(self.make_safe):
            self.before_light()
            self.set_light(wavelength_nm)
            self.lit = True
            self.laser.emit()
            self.limits.check_power(self.laser.power())
            yield

    def load_drive(self, drive: Drive, *, periods_per_trigger: float | None = None) -> None:
        """Load `drive` into the AWG as `Awg.load` does, under the limit of the RF amplitude.

        Raises:
            OverLimit: its amplitude exceeds the limit, and nothing was sent; or the one that the AWG settled on does.
            InstrumentError: the AWG refuses it, or settles on something else.
        """
        self.limits.check_amplitude(drive.amplitude_vpp)
        told = partial(self.uploading, "waveform")
        loaded = self.awg.load(drive, periods_per_trigger=periods_per_trigger, progress=told)
        self.limits.check_amplitude(loaded.amplitude_vpp)

    def make_safe(self) -> None:
        """Laser off, AWG off, DMD blank, oscilloscope stopped: in this order, and each one even if another fails.

        Raises:
            UnsafeBench: an instrument did not obey.
        """
        with self.undisturbed():
            try:
                safe_state({name: instrument.make_safe for name, instrument in self.instruments.items()})
            except UnsafeBench as error:
                self.left_lit = (self.lit or self.left_lit) and "laser" in error.disobeyed
                self.lit = False
                raise
            self.lit = self.left_lit = False

    def close(self) -> None:
        """Release every connection, each one even if another fails.

        Raises:
            InstrumentError: an instrument failed while it was released; others that did are notes to it.
        """
        with ExitStack() as stack:
            for instrument in reversed(self.instruments.values()):
                stack.enter_context(ending_with(instrument.close))


@contextmanager
def ending_with(end: Callable[[], None]) -> Iterator[None]:
    """Call `end` after the block, however it ends.

    An error of the block stays the one that is raised, since it came first: what `end` then fails at is a note to it.
    """
    try:
        yield
    except GeneratorExit:  # no failure of the block, and nobody would read a note to it
        end()
        raise
    except BaseException as error:
        try:
            end()
        except (InstrumentError, OSError) as failure:
            for line in (str(failure), *getattr(failure, "__notes__", ())):
                error.add_note(line)
        raise
    else:
        end()


def safe_state(steps: dict[str, Callable[[], None]]) -> None:
    """Take the steps of instruments, by name, into the safe state: in their order, each one however another ends.

    Raises:
        UnsafeBench: an instrument did not obey.
    """
    failures: dict[str, InstrumentError | OSError] = {}

    def take(name: str, step: Callable[[], None]) -> None:
        try:
            _over_a_new_link(step)
        except (InstrumentError, OSError) as error:
            failures[name] = error

    with ExitStack() as stack:  # which calls them all, whatever one of them raises
        for name, step in reversed(steps.items()):
            stack.callback(take, name, step)
    if failures:
        told = "; ".join(f"{name}: {error}" for name, error in failures.items())
        dark = "laser" in steps and "laser" not in failures
        advice = "the laser is off" if dark else "the laser may still emit, switch it off by its key switch"
        raise UnsafeBench(f"the safe state is not confirmed ({told}): {advice}", failures)


def _over_a_new_link(step: Callable[[], None]) -> None:
    """Once more if the link that is there was broke unnoticed, as links do while nothing is said."""
    try:
        step()
    except LinkError:
        step()
