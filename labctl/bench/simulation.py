"""The simulated bench of a station, in this process."""

from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from instruments.alnair_tlg220 import Tlg220Section
from instruments.laser_table import CommandTable
from instruments.sections import SIMULATED
from instruments.ti_dlpc900 import TiDlpc900Section
from instruments.toml_files import describe, read_toml
from labctl.bench.station import Station
from labctl.errors import StationError

if TYPE_CHECKING:  # a bench of real instruments does without
    from sim_backends.bench import SimulatedBench as SimulatedBench
    from sim_backends.faults.bench import FaultyBench
    from sim_backends.faults.specification import Listed
    from sim_backends.parameters import Parameters

SIMULATED_LASER = Path(str(files("sim_backends") / "virtual" / "tlg220" / "commands.toml"))
"""Command table of the simulated laser."""


def with_laser_commands(station: Station) -> Station:
    """`station` with the simulated laser's command table by its path, where the station has that laser or names it."""
    laser = station.laser
    if isinstance(laser, Tlg220Section):
        unnamed = laser.commands is None and "laser" in station.simulations
        if unnamed or str(laser.commands) == SIMULATED:
            return station.model_copy(update={"laser": laser.model_copy(update={"commands": SIMULATED_LASER})})
    return station


def simulated_bench(
    station: Station, *, host: str = "127.0.0.1", port_base: int | None = None, faults: Sequence[str] = ()
) -> "FaultyBench":
    """The simulated bench of `station`, not started; its laser speaks the station's command table if it names one.

    `faults` befall its instruments, each as `sim_backends.faults.specification` reads it.

    Raises:
        StationError: there is no such fault.
    """
    from sim_backends.faults.bench import FaultyBench
    from sim_backends.faults.specification import FaultError, read_fault
    from sim_backends.virtual.alp.instrument import VirtualAlp
    from sim_backends.virtual.dlpc900.instrument import VirtualDlpc900

    try:
        befalling = [read_fault(fault) for fault in faults]
    except FaultError as error:
        raise StationError(f"--fault {error}") from None
    laser = with_laser_commands(station).laser
    laser_table = None
    if isinstance(laser, Tlg220Section) and laser.commands is not None:
        CommandTable.read(laser.commands)
        laser_table = read_toml(laser.commands)
    return FaultyBench(
        befalling,
        _parameters(station),
        twin_seed=station.sim.twin_seed,
        host=host,
        port_base=port_base,
        laser_table=laser_table,
        dmd=VirtualDlpc900 if isinstance(station.dmd, TiDlpc900Section) else VirtualAlp,
    )


def known_faults() -> "list[Listed]":
    """The faults that a simulated bench can be asked for."""
    from sim_backends.faults.specification import listed

    return listed()


def _parameters(station: Station) -> "Parameters":
    from sim_backends.parameters import Parameters

    try:
        return Parameters.model_validate(
            {"light_path": "projector" if station.wiring.projector else "direct", **station.sim.parameters}
        )
    except ValidationError as error:
        raise StationError(f"{station.source}: sim.parameters: {describe(error)}") from None
