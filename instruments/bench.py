"""The bench: opened instruments with their wiring and limits, what they do together, and who follows it."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.errors import InstrumentError, LightLost, LinkError, NotConfigured, OutOfRange, SettingChanged
from instruments.interfaces import BYPASS_PORT, Awg, Dmd, Instrument, Oscilloscope, PatchPanel, TunableLaser
from instruments.limits import Levels, Limits, OverLimit
from instruments.optical_train import OpticalTrain
from instruments.safe_state import LIGHT, MAY_EMIT, UnsafeBench, ending_with, in_order, safe_state
from instruments.values import Drive, EdgeTrigger, Frames, Identity, Timebase


class Observer:
    """Follows a bench and a run on it. Every method is empty: a listener has those that it needs."""

    def before_light(self) -> None:
        """Light is asked for, or a person for what comes before it. What is raised here refuses it."""

    def while_lit(self) -> None:
        """Light is to stay on for another while, in which nothing is recorded. What is raised here ends it."""

    def emission(self, *, on: bool) -> None:
        """Light is about to be switched on, or is confirmed off: whoever listens never takes light for dark."""

    def safe_state(self, error: UnsafeBench | None) -> None:
        """The way into the safe state has come to its end; `error` says which instruments did not obey."""

    def event(self, name: str, **fields: Any) -> None:
        """A setting has settled, or the run has come to another stage: names and fields of `events.jsonl`."""

    def identified(self, name: str, identity: Identity) -> None:
        """The instrument called `name` has said who it is; what is raised here refuses it."""

    def uploading(self, what: str, done: int, total: int) -> None:
        """So much of a waveform or of pictures is uploaded, of so much in all. What is raised here ends it."""

    def step(self, name: str) -> AbstractContextManager[Any]:
        """One step of a shot is taken inside the block; see `labctl.engine.profile` for the names."""
        return nullcontext()

    def acquired(self) -> None:
        """The oscilloscope has given the records of one acquisition."""

    def powers(self, found: Mapping[str, float]) -> None:
        """What `OpticalTrain.check_powers` has found, again and again while there is light."""

    def stored_in(self, directory: Path) -> None:
        """The run has a directory from now on."""

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """So many records of so many are done; `last` says what is known of the shot that was measured last."""

    def warning(self, text: str) -> None:
        """Something is not as it should be, and the run goes on."""


class Observers(Observer):
    """Several observers as one, each called in turn."""

    def __init__(self, *observers: Observer) -> None:
        """Of `observers`, the first of them first."""
        self._observers: list[Observer] = []
        self._timers: list[Observer] = []
        for observer in observers:
            self.add(observer)

    def add(self, observer: Observer) -> None:
        """One more."""
        self._observers.append(observer)
        if type(observer).step is not Observer.step:
            self._timers.append(observer)

    def follow(self, *observers: Observer) -> None:
        """These alone, from now on."""
        self._observers.clear()
        self._timers.clear()
        for observer in observers:
            self.add(observer)

    def before_light(self) -> None:
        """As of each."""
        for observer in self._observers:
            observer.before_light()

    def while_lit(self) -> None:
        """As of each."""
        for observer in self._observers:
            observer.while_lit()

    def emission(self, *, on: bool) -> None:
        """As of each."""
        for observer in self._observers:
            observer.emission(on=on)

    def safe_state(self, error: UnsafeBench | None) -> None:
        """As of each."""
        for observer in self._observers:
            observer.safe_state(error)

    def event(self, name: str, **fields: Any) -> None:
        """As of each."""
        for observer in self._observers:
            observer.event(name, **fields)

    def identified(self, name: str, identity: Identity) -> None:
        """As of each."""
        for observer in self._observers:
            observer.identified(name, identity)

    def uploading(self, what: str, done: int, total: int) -> None:
        """As of each."""
        for observer in self._observers:
            observer.uploading(what, done, total)

    def step(self, name: str) -> AbstractContextManager[Any]:
        """Inside the steps of those that time them."""
        if not self._timers:
            return nullcontext()
        stack = ExitStack()
        for observer in self._timers:
            stack.enter_context(observer.step(name))
        return stack

    def acquired(self) -> None:
        """As of each."""
        for observer in self._observers:
            observer.acquired()

    def powers(self, found: Mapping[str, float]) -> None:
        """As of each."""
        for observer in self._observers:
            observer.powers(found)

    def stored_in(self, directory: Path) -> None:
        """As of each."""
        for observer in self._observers:
            observer.stored_in(directory)

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """As of each."""
        for observer in self._observers:
            observer.progress(done, total, last)

    def warning(self, text: str) -> None:
        """As of each."""
        for observer in self._observers:
            observer.warning(text)


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


@dataclass
class Bench:
    """The opened instruments of a station, and what a protocol does with them.

    Five there always are. `train` has those behind the laser; `others`, by role, those that only their drivers know:
    they are identified, noted, made safe and closed with the rest, and what else is asked of them a protocol decides.
    A protocol works through the methods here, so that `observer` follows it; of the instruments themselves it asks what
    they can do. `armed` says that a person has allowed light. `played`: a recording answers, nothing emits. `source` is
    the file that describes the bench, for messages. `now` gives the time of the bench in seconds: a monotonic clock on
    a real bench, the virtual clock of a simulated one. `undisturbed` keeps what would stop the program out of the way
    into the safe state. `simulated_still`: what simulates or plays instruments, if anything does, has not failed. `lit`
    says that light was switched on, and that the safe state was not reached since.
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
    train: OpticalTrain = field(default_factory=OpticalTrain)
    others: Mapping[str, Instrument] = field(default_factory=dict)
    observer: Observer = field(default_factory=Observer)
    played: bool = False
    undisturbed: Callable[[], AbstractContextManager[None]] = nullcontext
    simulated_still: Callable[[], bool] = lambda: True
    lit: bool = field(default=False, init=False)

    @property
    def instruments(self) -> dict[str, Instrument]:
        """The instruments by name, in the order of the safe state where it has one."""
        always = {
            "laser": self.laser,
            "awg": self.awg,
            "dmd": self.dmd,
            "scope": self.scope,
            "patch_panel": self.patch_panel,
        }
        return in_order({**always, **self.train.instruments, **self.others})

    def __post_init__(self) -> None:
        """Compare the levels with the limits and with what the AWG can give, before anything can be sent.

        Raises:
            OutOfRange: a power or the RF amplitude exceeds its limit, or the AWG does not give it.
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

        `BYPASS_PORT` is patched alone: its fibre goes to a detector or into the chip. A pass comes where the first of
        its ports does. Where the chip is bypassed there is one fibre to measure, whatever ports are asked for.

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
        channels = self.wiring.channels
        behind = [port for port in ports if port != BYPASS_PORT]
        passes = [behind[first : first + len(channels)] for first in range(0, len(behind), len(channels))]
        if BYPASS_PORT in ports:
            passes.append([BYPASS_PORT])
        passes.sort(key=lambda together: ports.index(together[0]))
        return tuple(dict(zip(channels, together, strict=False)) for together in passes)

    # --- light

    def set_light(self, wavelength_nm: float) -> Light:
        """Set power and wavelength without switching the laser on; returns what it settled on.

        Raises:
            OutOfRange: outside the laser's range.
            OverLimit: by its own answer, it gives more than the limit.
            InstrumentError: it does not settle there.
        """
        power_w = self.laser.set_power(self.levels.optical_power_w)
        self.observer.event("power set", power_w=power_w)
        self.limits.check_power(power_w)
        return Light(wavelength_nm=self.tune(wavelength_nm), power_w=power_w)

    def tune(self, wavelength_nm: float) -> float:
        """`TunableLaser.tune`; a laser that tunes may be dark, so that no amplifier is on meanwhile."""
        self.train.shut()
        settled = self.laser.tune(wavelength_nm)
        self.train.follow(settled)
        self.observer.event("tuned", wavelength_nm=settled)
        if self.lit:
            self._let_through()
        return settled

    @contextmanager
    def emitting(self, wavelength_nm: float, patching: Mapping[int, int] | None = None) -> Iterator[None]:
        """The only way to light: emission inside the block, the safe state however it ends.

        patching: what the block connects first; a person is asked for it before there is light.

        Raises:
            NotConfigured: the bench is not armed; nothing was sent.
            InstrumentError: somebody left something that no run may change; the laser stays off.
            OverLimit: by its own answer or the power meter's, the laser gives more than the limit; or the amplifier.
            SettingChanged: the block failed because of a setting that was changed from elsewhere.
            UnsafeBench: an instrument did not obey. Where the block fails, this is a note to its error.
        """
        self.require_arm()
        with ending_with(self.make_safe):
            for name, instrument in self.instruments.items():
                for obstacle in instrument.obstacles():
                    raise InstrumentError(f"{name}: {obstacle}")
            if patching is not None and self.patch_panel.asks(patching):
                self.connect(patching)
            self.observer.before_light()
            self.set_light(wavelength_nm)
            self._switch_on()
            with self.explained():
                yield

    @contextmanager
    def explained(self) -> Iterator[None]:
        """An instrument that answers and fails may do so because of a setting that somebody else has changed.

        It is looked for before the safe state changes settings too. Light that went out is told before it: nobody may
        mend a setting, and so switch it on again, who does not know why.

        Raises:
            SettingChanged, LightLost, OverLimit: the reason, in place of the error of the block.
        """
        try:
            yield
        except InstrumentError as error:
            if self.lit and not isinstance(error, LinkError | LightLost | OverLimit | SettingChanged):
                try:
                    self.laser.require_emission()
                    self.require_unchanged()
                except LinkError:
                    raise error from None
            raise

    def _switch_on(self) -> None:
        self.observer.before_light()  # once more: a person may have been asked for the laser's settings
        self.lit = True
        self.observer.emission(on=True)
        self.laser.emit()
        self.limits.check_power(self.laser.power())
        self._let_through()

    def _let_through(self) -> None:
        if found := self.train.let_through(self.laser, self.limits):
            self.observer.event("light let through", **found)

    def make_safe(self) -> None:
        """Laser off, AWG off, DMD blank, oscilloscope stopped: in this order, and each one even if another fails.

        Before the laser, where the bench has them, attenuator shut and amplifier off; behind the rest, the others.

        Raises:
            UnsafeBench: an instrument did not obey.
        """

        def darken() -> None:
            self.laser.make_safe()
            self.observer.emission(on=False)

        def silence() -> None:
            self.awg.make_safe()
            self.observer.event("drive", on=False)

        steps = {name: instrument.make_safe for name, instrument in self.instruments.items()}
        with self.undisturbed():
            try:
                safe_state(steps | {"laser": darken, "awg": silence}, emits=not self.played)
            except UnsafeBench as error:
                self.lit = False
                self.observer.safe_state(error)
                raise
            self.lit = False
            self.observer.safe_state(None)

    def darken(self, names: Iterable[str]) -> None:
        """Take the instruments `names` alone into the safe state, in this order: somebody may have left them on.

        Raises:
            UnsafeBench: one did not obey; one that may still emit counts as light of this bench for its observer.
        """
        with self.undisturbed():
            try:
                safe_state({name: self.instruments[name].make_safe for name in names}, emits=not self.played)
            except UnsafeBench as error:
                if not error.disobeyed.isdisjoint(MAY_EMIT):
                    self.observer.emission(on=True)
                self.observer.safe_state(error)
                raise

    # --- what somebody else may do meanwhile

    def require_unchanged(self) -> None:
        """Compare the optical powers with their limits, and every instrument with what it was set to.

        Raises:
            OverLimit: the laser gives more than the limit, by its own answer or the power meter's; or the amplifier.
            LightLost: light that was let through behind the laser no longer is.
            SettingChanged: something was changed from elsewhere; the message has its old and its new value.
            LinkError: an instrument does not answer.
        """
        self.limits.check_power(self.laser.power())
        if found := self.train.check_powers(self.limits):
            self.observer.powers(found)
        if self.lit:
            self.train.require_light()
        for name, instrument in self.instruments.items():
            for change in instrument.changes():
                raise SettingChanged(
                    f"{name}: {change.setting} was {change.then} and is {change.now}: it was changed from elsewhere, "
                    f"leave the bench to this run"
                )

    # --- drive

    def load_drive(self, drive: Drive, *, periods_per_trigger: float | None = None) -> None:
        """Load `drive` into the AWG as `Awg.load` does, under the limit of the RF amplitude.

        Raises:
            OverLimit: its amplitude exceeds the limit, and nothing was sent; or the one that the AWG settled on does.
            InstrumentError: the AWG refuses it, or settles on something else.
        """
        self.limits.check_amplitude(drive.amplitude_vpp)
        progress = partial(self.observer.uploading, "waveform")
        with self.observer.step("upload"):
            loaded = self.awg.load(drive, periods_per_trigger=periods_per_trigger, progress=progress)
        self.limits.check_amplitude(loaded.amplitude_vpp)

    def play_drive(self) -> None:
        """`Awg.play`."""
        self.awg.play()
        self.observer.event("drive", on=True)

    def stop_drive(self) -> None:
        """`Awg.stop`."""
        self.awg.stop()
        self.observer.event("drive", on=False)

    # --- pictures

    def show(self, mirrors: NDArray[np.uint8]) -> None:
        """`Dmd.show`."""
        with self.observer.step("dmd"):
            self.dmd.show(mirrors)

    # --- traces

    def connect(self, patching: Mapping[int, int]) -> None:
        """`PatchPanel.connect`; no light is on while a person moves fibres, and it is switched on again thereafter.

        Raises:
            OutOfRange: a port that is not wired.
            UnsafeBench: what gives light did not obey; nobody was asked to touch a fibre.
            InstrumentError, OverLimit: the panel failed, or the light as in `emitting`.
        """
        for_good = self.wiring.bypass and BYPASS_PORT not in self.patch_panel.ports  # it is plugged in, past the panel
        asks = not for_good and self.patch_panel.asks(patching)
        if asks:
            self.observer.before_light()
        was_lit = self.lit and asks
        if was_lit:
            self.lit = False
            self.darken(name for name in LIGHT if name in self.instruments)
            self.observer.emission(on=False)
        if not for_good:
            self.patch_panel.connect(patching)
        self.observer.event("patched", ports={str(channel): port for channel, port in patching.items()})
        if was_lit:
            self.train.shut()  # who was at the bench may have touched that too
            self._switch_on()

    def configure(self, timebase: Timebase, channels: Iterable[int], averages: int = 1) -> None:
        """`Oscilloscope.configure`, with the trigger of the wiring."""
        channels = tuple(channels)
        self.scope.configure(timebase, self.wiring.trigger, channels, averages)
        self.observer.event(
            "scope set", channels=list(channels), sample_rate=timebase.sample_rate, samples=timebase.samples
        )

    def capture(self) -> Frames:
        """One acquisition: arm, wait for the trigger, read."""
        with self.observer.step("arm"):
            self.scope.arm()
        with self.observer.step("trigger"):
            self.scope.wait()
        with self.observer.step("transfer"):
            frames = self.scope.read()
        self.observer.acquired()
        return frames

    def capture_burst(self, frames: int, play: Callable[[], None]) -> Frames:
        """One frame at each of the next `frames` triggers, which `play` sets off once the oscilloscope is ready."""
        with self.observer.step("arm"):
            self.scope.arm_burst(frames)
        with self.observer.step("dmd"):
            play()
        with self.observer.step("transfer"):
            burst = self.scope.read_burst()
        self.observer.acquired()
        return burst

    def close(self) -> None:
        """Release every connection, each one even if another fails.

        Raises:
            InstrumentError: an instrument failed while it was released; others that did are notes to it.
        """
        with ExitStack() as stack:
            for instrument in reversed(self.instruments.values()):
                stack.enter_context(ending_with(instrument.close))
