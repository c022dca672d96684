"""The installed drivers, by the names that a station file uses: the entry points of the group `labctl.instruments`."""

import sys
from contextlib import suppress
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from instruments.driver import Driver
from instruments.errors import excerpt
from labctl.errors import IMPORT_FAILURES, StationError

GROUP = "labctl.instruments"


def driver(role: str, name: str) -> Driver[Any]:
    """The driver called `name`, for the instrument `role`.

    Raises:
        StationError: no installed package offers it, it does not load, or it drives another instrument.
    """
    found = _entry_points(tuple(sys.path)).get(name)
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
    for name, point in sorted(_entry_points(tuple(sys.path)).items()):
        with suppress(*IMPORT_FAILURES):
            found[name] = load(point)
    return {name: one for name, one in found.items() if role in (None, one.role)}


def load(point: EntryPoint) -> Driver[Any]:
    """The driver that an entry point names.

    Raises:
        ImportError: it is no driver. An incomplete package fails with any of `IMPORT_FAILURES`.
    """
    found = point.load()
    if not isinstance(found, Driver):
        raise ImportError(f"{point.value} is no instruments.driver.Driver")
    return found


def _refused(role: str, name: str, why: str) -> StationError:
    return StationError(f"{role}.driver = {excerpt(name)} {why}: choose one of {', '.join(installed(role))}")


@cache
def _entry_points(_search_path: tuple[str, ...]) -> dict[str, EntryPoint]:
    """Looked up once for each search path: that reads a file of every package, and a bench has five drivers."""
    return {point.name: point for point in entry_points(group=GROUP)}
