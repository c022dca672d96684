"""Whether the laser of a station goes where a protocol sends it: found out from its command table, in the dark."""

import math
from collections.abc import Collection

from instruments.alnair_tlg220 import Command, CommandTable
from instruments.errors import NotConfigured
from labctl.bench.opening import laser_commands
from labctl.bench.station import Station
from labctl.errors import StationError


def check_laser(station: Station, wavelengths_nm: Collection[float]) -> None:
    """Compare wavelengths and the station's optical power with the limits in the laser's command table.

    A laser without a table, one that is set by hand for instance, has no limits that are known here.

    Raises:
        StationError: outside the limits, or the table cannot be read.
    """
    commands = laser_commands(station)
    if commands is None:
        return
    try:
        table = CommandTable.read(commands)
    except NotConfigured as error:
        raise StationError(f"{station.source}: {error}") from None
    tuning, power = table.commands.get("set_wavelength"), table.commands.get("set_power")
    for wavelength in wavelengths_nm:
        if tuning is not None and not tuning.min <= wavelength <= tuning.max:
            reach = f"stays at {tuning.min:g} nm" if tuning.min == tuning.max else f"tunes over {_span(tuning)} nm"
            raise StationError(
                f"{station.source}: {wavelength:g} nm are asked for, but the laser of {commands} {reach}: choose other "
                f"wavelengths, or name a laser that tunes there (laser.driver, laser.commands)"
            )
    power_dbm = 10 * math.log10(station.laser.power / 1e-3) if station.laser.power > 0 else -math.inf
    if power is not None and not power.min <= power_dbm <= power.max:
        raise StationError(
            f"{station.source}: laser.power = {station.laser.power * 1e3:g} mW is {power_dbm:.2f} dBm, but the laser "
            f"of {commands} gives {_span(power)} dBm: choose a power inside"
        )


def _span(command: Command) -> str:
    return f"{command.min:g}..{command.max:g}"
