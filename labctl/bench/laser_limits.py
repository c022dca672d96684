"""Whether the laser of a station goes where a protocol sends it: its driver says so before anything is opened."""

from collections.abc import Collection

from instruments.errors import NotConfigured
from instruments.units import DIGITS, decibels_milliwatt
from instruments.values import Range
from labctl.bench.simulation import with_laser_commands
from labctl.bench.station import Station
from labctl.errors import StationError


def check_laser(station: Station, wavelengths_nm: Collection[float]) -> None:
    """Compare wavelengths and the station's optical power with the ranges that the laser's driver states.

    A laser whose driver states none, one that is set by hand for instance, has no limits that are known here.

    Raises:
        StationError: outside the ranges, or they cannot be read.
    """
    laser = with_laser_commands(station).laser
    try:
        ranges = station.driver_of("laser").ranges(laser)
    except NotConfigured as error:
        raise StationError(f"{station.source}: {error}") from None
    if ranges is None:
        return
    tuning, power = ranges.wavelength, ranges.power
    for wavelength in wavelengths_nm:
        if not tuning.low <= wavelength <= tuning.high:
            reach = (
                f"stays at {tuning.low:{DIGITS}} nm" if tuning.low == tuning.high else f"tunes over {_span(tuning)} nm"
            )
            keys = "laser.driver" + (f", laser.{ranges.key}" if ranges.key else "")
            raise StationError(
                f"{station.source}: {wavelength:{DIGITS}} nm are asked for, but the laser of {ranges.source} {reach}: "
                f"choose other wavelengths (laser.wavelength where a protocol sets none), or name a laser that tunes "
                f"there ({keys})"
            )
    power_dbm = decibels_milliwatt(laser.power)
    if not power.low <= power_dbm <= power.high:
        raise StationError(
            f"{station.source}: laser.power = {laser.power * 1e3:g} mW is {power_dbm:.7g} dBm, but the laser "
            f"of {ranges.source} gives {_span(power)} dBm: choose a power inside"
        )


def _span(limits: Range) -> str:
    return f"{limits.low:{DIGITS}}..{limits.high:{DIGITS}}"
