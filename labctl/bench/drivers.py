"""The installed drivers, by the names that a station file uses: the entry points of the group `labctl.instruments`."""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any

from instruments.driver import Driver
from instruments.errors import excerpt
from instruments.interfaces import INTERFACES, Instrument
from instruments.plug_ins import package_of, plug_ins
from labctl.errors import IMPORT_FAILURES, StationError

GROUP = "labctl.instruments"
VIRTUAL_GROUP = "labctl.virtual_instruments"
"""Entry points of this group have the name of the driver whose instrument they simulate."""


@dataclass(frozen=True)
class Listed:
    """A driver as it is listed.

    Attributes:
        name: As station files name it.
        role: The table of the station file that it is for; empty if it does not load.
        interface: What protocols may ask of its instrument.
        package: The distribution that it comes with.
        virtual: The distribution that simulates its instrument; empty where nothing does.
        problem: Why it does not load; empty if it does.
    """

    name: str
    role: str = ""
    interface: str = ""
    package: str = ""
    virtual: str = ""
    problem: str = ""


def driver(role: str, name: str) -> Driver[Any]:
    """The driver called `name`, for the instrument `role`.

    Raises:
        StationError: no installed package offers it, it does not load, or it drives another instrument.
    """
    found = plug_ins(GROUP).get(name)
    if found is None:
        raise _refused(role, name, "is not installed")
    try:
        loaded = load(found)
    except IMPORT_FAILURES as error:
        raise _refused(role, name, f"does not load ({' '.join(str(error).split())})") from None
    if loaded.role != role:
        raise _refused(role, name, f"is a driver of {loaded.role}")
    return loaded


def installed(role: str | None = None) -> dict[str, Driver[Any]]:
    """Every driver, or every one of a role, by name; without those that do not load, which `labctl doctor` names."""
    found = {}
    for name, point in plug_ins(GROUP).items():
        with suppress(*IMPORT_FAILURES):
            found[name] = load(point)
    return {name: one for name, one in found.items() if role in (None, one.role)}


def sent_anew(manifest: Mapping[str, Any]) -> Iterator[str]:
    """The settings in a manifest that its run sent before the first record, as patterns of names.

    None of an instrument whose driver is not installed here.
    """
    match manifest:
        case {"station": dict(station), "instruments": dict(instruments)}:
            for role in instruments:
                match station.get(role):
                    case {"driver": str(name)}:
                        with suppress(StationError):
                            sent = driver(role, name).sent_anew
                            yield from (f"instruments.{role}.settings.{setting}" for setting in sent)


def listed(simulated: tuple[str, ...]) -> list[Listed]:
    """Every driver as it is listed, by role and name; those that do not load are the last.

    simulated: the drivers whose instruments the simulated bench has without a plug-in.
    """
    found = [_listed(name, point, simulated) for name, point in plug_ins(GROUP).items()]
    return sorted(found, key=lambda one: (bool(one.problem), one.role, one.name))


def load(point: EntryPoint) -> Driver[Any]:
    """The driver that an entry point names.

    Raises:
        ImportError: it is no driver. An incomplete package fails with any of `IMPORT_FAILURES`.
    """
    found = point.load()
    if not isinstance(found, Driver):
        raise ImportError(f"{point.value} is no instruments.driver.Driver")
    return found


def _listed(name: str, point: EntryPoint, simulated: tuple[str, ...]) -> Listed:
    package = package_of(point)
    try:
        found = load(point)
    except IMPORT_FAILURES as error:
        return Listed(name, package=package, problem=" ".join(str(error).split()))
    twin = plug_ins(VIRTUAL_GROUP).get(name)
    virtual = package_of(twin) if twin is not None else package if name in simulated else ""
    return Listed(name, found.role, INTERFACES.get(found.role, Instrument).__name__, package, virtual)


def _refused(role: str, name: str, why: str) -> StationError:
    known = installed(role)
    advice = f"choose one of {', '.join(known)}" if known else f"no installed driver is for [{role}]"
    return StationError(f"{role}.driver = {excerpt(name)} {why}: {advice}")
