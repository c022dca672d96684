"""From a station to an opened bench."""

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

from instruments.bench import Bench, Observer, Wiring
from instruments.driver import Opening
from instruments.errors import InstrumentError, NotConfigured
from instruments.interfaces import INTERFACES, Awg, Instrument
from instruments.limits import Levels, Limits
from instruments.optical_train import OpticalTrain
from instruments.safe_state import MAY_EMIT, ending_with, in_order
from instruments.sections import SIMULATED, AmplifierSection, AttenuatorSection, PowerMeterSection
from instruments.transcripts import Transcript
from instruments.values import EdgeTrigger
from labctl.bench.operator import ask_operator
from labctl.bench.recording.recorder import recorded
from labctl.bench.recording.wire import Wire
from labctl.bench.signals import stops_deferred
from labctl.bench.simulation import simulated_bench as simulated_bench
from labctl.bench.simulation import with_laser_commands, without_card
from labctl.bench.station import Station
from labctl.errors import StationError

if TYPE_CHECKING:  # a bench of real instruments does without
    from labctl.bench.simulation import SimulatedBench


@dataclass(frozen=True)
class Access:
    """How a bench is opened.

    attended: somebody is at it. armed: light is allowed, whatever the station says. wire: what becomes of its messages.
    """

    attended: bool = False
    armed: bool = False
    wire: Wire = Wire()


@dataclass(frozen=True)
class OpenBench:
    """An opened bench; `simulation` is the simulated bench behind it, if this process runs one."""

    bench: Bench
    simulation: "SimulatedBench | None"


@contextmanager
def opened(
    station: Station, transcript: Transcript, access: Access = Access(), *, observer: Observer | None = None
) -> Iterator[OpenBench]:
    """The bench of `station`, released at the end however the block ends.

    Instruments whose address is "simulated" are served by a simulated bench in this process, over real sockets. No
    message is sent here: a station that is wrong is refused before any instrument is spoken to.

    `observer` follows the bench. Where there is no light but in a simulation of this process or in a recording, nobody
    is asked to allow it.

    Raises:
        StationError: a driver that does not exist, or a laser that must not be switched on; or one that is simulated
            before an amplifier that is not.
        RecordingError: the bench was to be recorded, and the recording cannot be written.
        OutOfRange: a level above its limit.
    """
    with _reached(station, transcript, access) as reach:
        try:
            bench = _bench(reach, observer := observer or Observer())
        except (NotConfigured, StationError) as error:
            raise StationError(f"{station.source}: {error}") from None
        with ending_with(bench.close):
            if reach.simulation is not None and reach.simulation.world.fallback:
                observer.warning(without_card(reach.simulation.world.fallback))
            yield OpenBench(bench, reach.simulation)


@contextmanager
def opened_one_by_one(
    station: Station, transcript: Transcript, access: Access = Access()
) -> Iterator[dict[str, Instrument | InstrumentError]]:
    """The instruments of `station` by name, each opened whatever becomes of another: one that cannot be is its error.

    To look at a bench; it is no `Bench`, so there is no way to light. Released at the end like one.

    Raises:
        StationError: a driver that does not exist.
        OutOfRange: a level above its limit.
    """
    _limits(station).check_levels(_levels(station), station.source)
    with ExitStack() as stack:
        reach = stack.enter_context(_reached(station, transcript, access))
        found: dict[str, Instrument | InstrumentError] = {}
        for name in in_order(station.addresses):
            try:
                found[name] = instrument = reach.open(name)
                stack.enter_context(ending_with(instrument.close))
                if isinstance(instrument, Awg):
                    instrument.amplitude.check(f"{station.source}: awg.amplitude", station.awg.amplitude)
            except InstrumentError as error:
                found[name] = error
            except StationError as error:
                raise StationError(f"{station.source}: {error}") from None
        yield found


@dataclass(frozen=True)
class _Reach:
    """A station whose instruments can be opened: with the addresses of a replay, the simulated bench running."""

    station: Station
    transcript: Transcript
    simulation: "SimulatedBench | None"
    access: Access

    @property
    def armed(self) -> bool:
        """Whether light is allowed, or there is none."""
        return self.access.armed or self.station.laser.armed or self.played or "laser" in self.station.simulations

    @property
    def played(self) -> bool:
        """Whether a recording answers in place of the laser."""
        return self.access.wire.replay is not None and "laser" not in self.station.by_hand

    def open(self, name: str) -> Any:
        """The instrument called `name`; no message is sent.

        Raises:
            StationError: nothing simulates it, or its driver gives something else than an instrument of this role.
        """
        section, driver = self.station.section_of(name), self.station.driver_of(name)
        address = section.address
        if not address:
            raise NotConfigured(f"{name}.address is empty: write its VISA address into {self.station.source}")
        if self.simulation is not None and address == SIMULATED and not driver.by_hand:
            if name not in self.simulation.resources:
                raise StationError(
                    f"{name}.address = {SIMULATED!r}, but nothing simulates what driver {section.driver!r} is for: "
                    f"write its VISA address"
                )
            address = self.simulation.resources[name]["socket"]
        opened = driver.open(section, Opening(address, self.transcript, ask_operator, self.access.attended))
        interface = INTERFACES.get(name, Instrument)
        if not isinstance(opened, interface):
            raise StationError(
                f"{name}.driver = {section.driver!r} gives {type(opened).__name__}, which is no {interface.__name__}: "
                f"correct the driver"
            )
        return opened


@contextmanager
def _reached(station: Station, transcript: Transcript, access: Access) -> Iterator[_Reach]:
    wire = access.wire
    with ExitStack() as stack:
        if wire.record is not None:
            transcript = stack.enter_context(recorded(transcript, station, wire.record))
        if wire.replay is not None:
            from labctl.bench.recording.replay import redirected  # with a server, which no other bench needs

            station = redirected(station, wire.replay)
        if station.partly_simulated and not station.mixed:
            raise StationError(
                f"{station.source}: {', '.join(station.simulations)} simulated, the other instruments real: "
                f"records would not be of the bench's light: write the missing addresses, or mixed = true"
            )
        station = with_laser_commands(station)
        simulation = stack.enter_context(simulated_bench(station)) if station.simulated else None
        yield _Reach(station, transcript, simulation, access)


def _levels(station: Station) -> Levels:
    amplifier = station.others.get("amplifier")
    amplified = amplifier.power if isinstance(amplifier, AmplifierSection) else 0.0
    return Levels(station.laser.power, station.awg.amplitude, amplified)


def _limits(station: Station) -> Limits:
    limits = station.limits
    return Limits(limits.optical_power, limits.rf_amplitude, limits.detector, limits.amplified_power)


def _train(reach: _Reach) -> OpticalTrain:
    """What stands behind the laser."""
    train = OpticalTrain()
    for name, section in reach.station.others.items():
        match section:
            case PowerMeterSection(tap=tap):
                train = replace(train, power_meter=reach.open(name), tap=tap)
            case AmplifierSection(power=power_w):
                train = replace(train, amplifier=reach.open(name), amplified_w=power_w)
            case AttenuatorSection(attenuation_db=attenuation_db):
                train = replace(train, attenuator=reach.open(name), attenuation_db=attenuation_db)
    return train


def _bench(reach: _Reach, observer: Observer) -> Bench:
    station, simulation = reach.station, reach.simulation
    if "laser" in station.simulations:  # for whose light nobody is asked
        for name in MAY_EMIT.keys() & set(station.roles).difference(station.simulations):
            raise StationError(
                f"the laser is simulated, the {name} is not: it would emit without a seed: write the laser's address, "
                f"or simulate both"
            )
    laser = reach.open("laser")
    if not (laser.switches_itself or reach.access.attended):
        raise NotConfigured(
            f"laser.driver = {station.laser.driver!r}: software cannot switch this laser off, its key switch is "
            f"the only interlock: stay at the bench and repeat with --attended"
        )
    trigger = station.scope
    train = _train(reach)
    return Bench(
        awg=reach.open("awg"),
        scope=reach.open("scope"),
        laser=laser,
        dmd=reach.open("dmd"),
        patch_panel=reach.open("patch_panel"),
        train=train,
        others={name: reach.open(name) for name in station.others if name not in train.instruments},
        levels=_levels(station),
        limits=_limits(station),
        wiring=Wiring(
            trigger=EdgeTrigger(trigger.trigger_source, trigger.trigger_level, trigger.trigger_slope == "rise"),
            channels=station.scope.channels,
            bypass=station.patch_panel.bypass,
            burst=station.wiring.burst,
            projector=station.wiring.projector,
        ),
        armed=reach.armed,
        played=reach.played,
        source=station.source,
        now=partial(getattr, simulation.world.clock, "now")
        if simulation is not None and "scope" in station.simulations
        else time.perf_counter,  # tells shots apart on Windows too
        observer=observer,
        undisturbed=stops_deferred,
        simulated_still=lambda: (simulation is None or not simulation.failed) and not reach.access.wire.differed(),
    )
