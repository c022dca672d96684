"""What a sweep is declared as, in a file or on the command line, and the points that it has on a bench."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import ValidationError

from instruments.remedies import unreadable
from instruments.toml_files import TomlError, describe, read_toml
from labctl.bench.station import Station
from labctl.errors import StationError, UsageError
from labctl.runs.sweep import Sweep, places
from labctl.runs.sweep_axes import values_of
from labctl.studies.run_tasks import asked_of
from protocols.base import Measurement
from protocols.registry import with_settings

SHORT = {"power": "laser.power", "wavelength": "wavelengths", "amplitude": "awg.amplitude"}
"""What is set often, and the setting or key of the station that sets it."""

NOTHING: Mapping[str, Any] = MappingProxyType({})


@dataclass(frozen=True)
class Point:
    """One run of a sweep: its folder's name, what is set, and where it lies on the axes, in SI units where numbers."""

    name: str
    values: Mapping[str, str]
    protocol: Measurement[Any]
    station: Station
    coordinates: Mapping[str, float | str]


def read_sweep(
    path: Path,
    *,
    over: Mapping[str, Sequence[str]] = NOTHING,
    settings: Mapping[str, str] = NOTHING,
    others: Mapping[str, Any] = NOTHING,
) -> Sweep:
    """The sweep that a TOML file declares: `protocol`, a table `[settings]`, a table `[over]` of lists or ranges.

    over, settings: beside those of the file, or instead of those of the same name. others: instead of other keys.

    Raises:
        UsageError: the file cannot be read, or says something else.
    """
    try:
        content = read_toml(path)
    except OSError as error:
        raise UsageError(unreadable(path, error, "name a protocol or a sweep file")) from None
    except TomlError as error:
        raise UsageError(f"{path}: is not TOML ({error}): correct that line") from None
    for table, more in (("over", over), ("settings", settings)):
        if isinstance(there := content.get(table, {}), dict) and more:  # anything else is refused
            content[table] = {**there, **more}
    return declared({**content, **others}, str(path))


def declared(content: Mapping[str, Any], origin: str) -> Sweep:
    """The sweep that `content`, which comes from `origin`, declares: what `Sweep` has, or text as values of an axis.

    Raises:
        UsageError: it says something else.
    """
    over = content.get("over")
    if isinstance(over, Mapping):
        over = {name: values_of(name, one) if isinstance(one, str) else one for name, one in over.items()}
        content = {**content, "over": over}
    try:
        return Sweep.model_validate(content)
    except ValidationError as error:
        raise UsageError(f"{origin}: {describe(error, Sweep.model_fields)}") from None


def refuse_set_twice(sweep: Sweep) -> None:
    """Refuse a new sweep that also sets what it varies: the setting would mean nothing.

    Raises:
        UsageError: it does.
    """
    if twice := [name for name in sweep.over if SHORT.get(name, name) in sweep.settings]:
        raise UsageError(f"{twice[0]}: is varied, and has one value among the settings: leave one of them out")


def points(sweep: Sweep, protocol: type[Measurement[Any]], station: Station) -> list[Point]:
    """Every run of a sweep of a protocol on a bench, in the order they are measured.

    Raises:
        UsageError: an axis is neither a setting nor a key of the station, sets what another one sets, or the axes do
            not fit each other.
        ProtocolError, StationError: a value does not fit.
    """
    return [_point(sweep, protocol, station, name, values) for name, values in places(sweep)]


def of_each(sweep: Sweep, protocol: type[Measurement[Any]], station: Station) -> dict[str, Any]:
    """What the manifest of every run of a sweep says, but for what is `varied`.

    Raises:
        UsageError, ProtocolError, StationError: as `points`.
    """
    name, values = places(sweep)[0]
    first = _point(sweep, protocol, station, name, values)
    return asked_of(first.protocol, first.station)


def varied(sweep: Sweep) -> tuple[str, ...]:
    """Patterns of what the axes of a sweep set, in a manifest."""
    targets = [SHORT.get(name, name) for name in sweep.over]
    return tuple(pattern for target in targets for pattern in (f"*.{target}", f"*.{target}.*"))


def _point(sweep: Sweep, asked: type[Measurement[Any]], station: Station, run: str, values: dict[str, str]) -> Point:
    settings, keys = {}, {}
    for name, value in values.items():
        target = SHORT.get(name, name)
        if target == "laser.wavelength":
            raise UsageError(
                f"{name}: {sweep.protocol} tunes the laser itself: vary a setting of it, such as wavelengths"
            )
        if target in settings or target in keys:
            raise UsageError(f"{name}: another axis sets {target} too, and a run has one value of it: leave one out")
        if target in asked.model_fields:
            settings[target] = value
        elif "." in target:
            keys[target] = value
        else:
            raise UsageError(
                f"{name}: is no setting of {sweep.protocol} and no key of the station: choose from "
                f"{', '.join([*SHORT, *asked.model_fields])}, or write a key such as laser.power"
            )
    protocol = with_settings(asked, sweep.settings | settings, origin="settings of the sweep")
    there = with_keys(station, keys)
    return Point(
        name=run,
        values=values,
        protocol=protocol,
        station=there,
        coordinates={name: _coordinate(SHORT.get(name, name), text, protocol, there) for name, text in values.items()},
    )


def with_keys(station: Station, keys: Mapping[str, str]) -> Station:
    """A bench with other values at keys such as "laser.power".

    Raises:
        StationError: it has no such key, or the value does not fit.
    """
    whole = station.model_dump()
    for key, value in keys.items():
        *tables, last = key.split(".")
        table: Any = whole
        for name in tables:
            table = table.get(name) if isinstance(table, dict) else None
        if not isinstance(table, dict) or (last not in table and tables != ["sim", "parameters"]):
            raise StationError(f"{key}: {station.source} has no such key: name one such as laser.power")
        table[last] = _number_or_text(value) if tables == ["sim", "parameters"] else value
    try:
        return Station.model_validate(whole) if keys else station
    except ValidationError as error:
        raise StationError(f"{', '.join(keys)}: {describe(error)}") from None


def _number_or_text(value: str) -> float | str:
    """A physical parameter of the simulated bench is a number without unit."""
    try:
        return float(value)
    except ValueError:
        return value


def _coordinate(target: str, text: str, protocol: Measurement[Any], station: Station) -> float | str:
    """What a value came to: a number in SI units, or its text."""
    found: Any = station.model_dump() if "." in target else protocol.model_dump()
    for name in target.split("."):
        found = found[name]
    if isinstance(found, tuple) and len(found) == 1:
        found = found[0]
    return float(found) if isinstance(found, int | float) and not isinstance(found, bool) else text
