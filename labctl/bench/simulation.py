"""The simulated bench of a station, in this process."""

from collections.abc import Sequence
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import ValidationError

from instruments.alnair_tlg220 import Tlg220Section
from instruments.interfaces import BYPASS_PORT
from instruments.laser_table import LaserTable
from instruments.plug_ins import plug_ins
from instruments.sections import SIMULATED
from instruments.ti_dlpc900 import TiDlpc900Section
from instruments.toml_files import describe, read_toml
from labctl.bench.drivers import VIRTUAL_GROUP
from labctl.bench.station import USUAL, Station
from labctl.errors import IMPORT_FAILURES, StationError

if TYPE_CHECKING:  # a bench of real instruments does without
    from sim_backends.bench import Make
    from sim_backends.bench import SimulatedBench as SimulatedBench
    from sim_backends.faults.bench import FaultyBench
    from sim_backends.faults.specification import Listed
    from sim_backends.parameters import Parameters

SIMULATED_LASER = Path(str(files("sim_backends") / "virtual" / "tlg220" / "commands.toml"))
"""Command table of the simulated laser."""
SIMULATION = "sim_backends.faults.bench"
"""The module that is loaded when the first simulated bench is made."""
SIMULATED_DRIVERS = (*USUAL.values(), "ti-dlpc900")
"""The drivers whose instruments the simulated bench has without a plug-in."""


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

    Its instruments are those that the station's drivers are for, as far as a package simulates them. `faults` befall
    them, each as `sim_backends.faults.specification` reads it.

    Raises:
        StationError: there is no such fault, or no fibre with such modes; or a package that simulates an instrument
            does not load.
    """
    from sim_backends.faults.bench import FaultyBench
    from sim_backends.faults.specification import FaultError, read_fault
    from sim_backends.optics.fibre import NoSuchModes
    from sim_backends.virtual.alp.instrument import VirtualAlp
    from sim_backends.virtual.dlpc900.instrument import VirtualDlpc900

    try:
        befalling = [read_fault(fault) for fault in faults]
    except FaultError as error:
        raise StationError(f"--fault {error}") from None
    for befallen in befalling:
        if (role := befallen.role) not in station.roles:
            raise StationError(f"--fault: no {role} on this bench: write a section [{role}] into the station file")
    laser = with_laser_commands(station).laser
    laser_table = None
    if isinstance(laser, Tlg220Section) and laser.commands is not None:
        LaserTable.read(laser.commands)
        laser_table = read_toml(laser.commands)
    try:
        bench = FaultyBench(
            befalling,
            physical_parameters(station),
            twin_seed=station.sim.twin_seed,
            noise=station.sim.noise,
            device=station.sim.device,
            host=host,
            port_base=port_base,
            laser_table=laser_table,
            plugged_in={role: make for role in station.roles if (make := _plugged_in(station, role)) is not None},
            dmd=VirtualDlpc900 if isinstance(station.dmd, TiDlpc900Section) else VirtualAlp,
        )
    except NoSuchModes as error:
        raise StationError(f"{station.source}: sim.parameters: {error}") from None
    if station.patch_panel.bypass:  # plugged in, until the panel is told to connect something
        bench.world.patch({station.scope.channels[0]: BYPASS_PORT})
    return bench


def without_card(missing: str) -> str:
    """What is said where a simulated bench was to be computed on a graphics card, which is `missing`."""
    return f"sim.device = cuda: {missing}: the simulated bench is computed on the processor"


def known_faults() -> "list[Listed]":
    """The faults that a simulated bench can be asked for."""
    from sim_backends.faults.specification import listed

    return listed()


def _plugged_in(station: Station, role: str) -> "Make | None":
    """What makes the virtual instrument of a role, given the world; None where no package plugs one in.

    What the entry point names is called with the world, and with what the station says of the instrument as JSON has
    it.
    """
    section = station.section_of(role)
    point = plug_ins(VIRTUAL_GROUP).get(section.driver)
    if point is None:
        return None
    try:
        make: Any = point.load()
    except IMPORT_FAILURES as error:
        raise StationError(
            f"{role}.driver = {section.driver!r}: its virtual instrument does not load ({' '.join(str(error).split())})"
        ) from None
    return partial(make, section=section.model_dump(mode="json"))


def physical_parameters(station: Station) -> "Parameters":
    """The physics of a simulated bench.

    Raises:
        StationError: the station asks for what cannot be.
    """
    from sim_backends.parameters import Parameters

    try:
        return Parameters.model_validate(
            {"light_path": "projector" if station.wiring.projector else "direct", **station.sim.parameters}
        )
    except ValidationError as error:
        raise StationError(f"{station.source}: sim.parameters: {describe(error)}") from None


def drive_depth_rad(station: Station) -> float:
    """Phase swing (rad) of a slow drive on a simulated bench: the AWG's amplitude behind the driver, which saturates.

    Raises:
        StationError: the station asks for what cannot be.
    """
    from sim_backends.optics.drive import amplified

    twin = physical_parameters(station)
    highest_v = amplified(np.array(station.awg.amplitude / 2), gain=twin.rf_gain, saturation_v=twin.rf_saturation_v)
    return float(2 * np.pi * highest_v / twin.v_pi_v)
