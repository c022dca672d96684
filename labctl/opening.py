"""From a station to an opened bench: the only place that knows the simulated bench exists."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from instruments.alnair_tlg220 import DEFAULT_TABLE, CommandTable
from instruments.bench import Bench, Wiring, ending_with
from instruments.errors import InstrumentError, NotConfigured
from instruments.limits import Levels, Limits
from instruments.toml_files import read_toml
from instruments.transcripts import Transcript
from instruments.values import EdgeTrigger
from labctl.drivers import Opening, driver
from labctl.interruption import stops_deferred
from labctl.replaying import redirected, replayed
from labctl.station import BY_HAND, SIMULATED, LaserSection, Station, StationError, describe
from labctl.tapping import recorded

if TYPE_CHECKING:  # a bench of real instruments does without
    from sim_backends.bench import SimulatedBench
    from sim_backends.faults.specification import Listed
    from sim_backends.parameters import Parameters

SIMULATED_LASER = Path(str(files("sim_backends") / "virtual" / "tlg220.toml"))
"""Command table of the simulated laser."""


@dataclass(frozen=True)
class OpenBench:
    """An opened bench; `simulation` is the simulated bench behind it, if this process runs one."""

    bench: Bench
    simulation: "SimulatedBench | None"


@contextmanager
def opened(
    station: Station, transcript: Transcript, *, attended: bool = False, armed: bool = False
) -> Iterator[OpenBench]:
    """The bench of `station`, released at the end however the block ends.

    Instruments whose address is "simulated" are served by a simulated bench in this process, over real sockets. No
    message is sent here: a station that is wrong is refused before any instrument hears of it.

    attended: somebody is at the bench. armed: light is allowed, whatever the station says; where there is no light but
    in a simulation of this process or in a recording, nobody is asked to allow it.

    Raises:
        StationError: a driver that does not exist, or a laser that must not be switched on.
        RecordingError: the bench was to be recorded, and the recording cannot be written.
        OutOfRange: a level above its limit.
    """
    with ExitStack() as stack:
        transcript = stack.enter_context(recorded(transcript, station))
        station = redirected(station)
        simulation = stack.enter_context(simulated_bench(station)) if station.simulated else None
        try:
            bench = _bench(station, transcript, simulation, attended=attended, armed=armed or _armed(station))
        except (NotConfigured, StationError) as error:
            raise StationError(f"{station.source}: {error}") from None
        stack.enter_context(ending_with(bench.close))
        yield OpenBench(bench, simulation)


def simulated_bench(
    station: Station, *, host: str = "127.0.0.1", port_base: int | None = None, faults: Sequence[str] = ()
) -> "SimulatedBench":
    """The simulated bench of `station`, not started; its laser speaks the station's command table if it names one.

    `faults` befall its instruments, each as `sim_backends.faults.specification` reads it.

    Raises:
        StationError: there is no such fault.
    """
    from sim_backends.faults.bench import FaultyBench
    from sim_backends.faults.specification import FaultError, read_fault

    try:
        befalling = [read_fault(fault) for fault in faults]
    except FaultError as error:
        raise StationError(f"--fault {error}") from None
    table = station.laser.commands
    laser_table = None
    if table is not None and str(table) != SIMULATED:
        CommandTable.read(table)
        laser_table = read_toml(table)
    return FaultyBench(
        befalling,
        _parameters(station),
        twin_seed=station.sim.twin_seed,
        host=host,
        port_base=port_base,
        laser_table=laser_table,
    )


def known_faults() -> "list[Listed]":
    """The faults that a simulated bench can be asked for."""
    from sim_backends.faults.specification import listed

    return listed()


def laser_commands(station: Station) -> Path | None:
    """The command table that the station's laser is driven from, None if its driver works without one."""
    laser = station.laser
    if laser.driver != LaserSection().driver:
        return None
    if str(laser.commands) == SIMULATED or (laser.commands is None and "laser" in station.simulations):
        return SIMULATED_LASER
    return laser.commands or DEFAULT_TABLE


def _parameters(station: Station) -> "Parameters":
    from sim_backends.parameters import Parameters

    try:
        return Parameters.model_validate(
            {"light_path": "projector" if station.wiring.projector else "direct", **station.sim.parameters}
        )
    except ValidationError as error:
        raise StationError(f"{station.source}: sim.parameters: {describe(error)}") from None


def _armed(station: Station) -> bool:
    shines = "laser" not in station.simulations and not (replayed() and station.laser.driver not in BY_HAND)
    return station.laser.armed or not shines


def _bench(
    station: Station, transcript: Transcript, simulation: "SimulatedBench | None", *, attended: bool, armed: bool
) -> Bench:
    def instrument(name: str) -> Any:
        section = getattr(station, name)
        address = section.address
        if simulation is not None and address == SIMULATED:
            address = simulation.resources[name]["socket"]
            if isinstance(section, LaserSection) and section.commands is None:
                section = section.model_copy(update={"commands": SIMULATED})
        return driver(section.driver)(section, Opening(address, transcript, ask_operator, attended, SIMULATED_LASER))

    laser = instrument("laser")
    if not (laser.switches_itself or attended):
        raise NotConfigured(
            f"laser.driver = {station.laser.driver!r}: software cannot switch this laser off, its key switch is "
            f"the only interlock: stay at the bench and repeat with --attended"
        )
    trigger = station.scope
    return Bench(
        awg=instrument("awg"),
        scope=instrument("scope"),
        laser=laser,
        dmd=instrument("dmd"),
        patch_panel=instrument("patch_panel"),
        levels=Levels(station.laser.power, station.awg.amplitude),
        limits=Limits(station.limits.optical_power, station.limits.rf_amplitude, station.limits.detector),
        wiring=Wiring(
            trigger=EdgeTrigger(trigger.trigger_source, trigger.trigger_level, trigger.trigger_slope == "rise"),
            channels=station.scope.channels,
            bypass=station.patch_panel.bypass,
            burst=station.wiring.burst,
            projector=station.wiring.projector,
        ),
        armed=armed,
        source=station.source,
        now=(lambda: simulation.world.clock.now)
        if simulation is not None and "scope" in station.simulations
        else time.time,
        undisturbed=stops_deferred,
    )


def ask_operator(request: str) -> str:
    """Ask at the terminal and wait for an answer.

    Raises:
        InstrumentError: nobody is there to answer.
    """
    print(request, end=": ", file=sys.stderr, flush=True)  # noqa: T201
    try:
        return input()
    except EOFError:
        raise InstrumentError(f"nobody answered {request!r}: run this from a terminal") from None
