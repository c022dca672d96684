"""What labctl is built on here: interpreter, packages, VISA, plug-ins, extras, data sets, space on the disk."""

import platform
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import EntryPoint, PackageNotFoundError, entry_points, requires, version
from pathlib import Path
from typing import Any

from packaging.requirements import Requirement

import labctl
from labctl.errors import IMPORT_FAILURES
from labctl.runs.format.provenance import DISTRIBUTION, this_version

OK, MISSING, BROKEN = "ok", "missing", "broken"

EXTRAS = {
    "alp": "ViALUX DMDs on USB",
    "cluster": "simulated benches on the workers of a dask cluster",
    "data": "runs as xarray Datasets, and their export as netCDF and zarr",
    "dashboard": "runs in a browser: labctl dashboard",
    "dlpc900": "TI DLPC900 DMDs on USB",
    "imaging": "image reconstruction by networks: experiments fig6 and s6",
    "serial": "instruments at serial ports, such as the laser",
    "store": "runs of other machines: on S3, behind SSH or web servers",
    "usb": "instruments on USB without a vendor's VISA library",
}
"""What each extra is for."""

MODULES = {"fonttools": "fontTools", "pillow": "PIL", "pyvisa-py": "pyvisa_py", "scikit-learn": "sklearn"}
"""Packages that are imported by another name than they are installed by."""

NETWORK = ("TCPIP SOCKET", "TCPIP INSTR")
"""The VISA resources that labctl cannot do without; every other kind is for some benches."""
VENDOR = "none: only benches on GPIB, or on USB by a vendor's driver, need one"


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at.

    Attributes:
        about: What kind of thing it is.
        name: Its name.
        state: `OK`; `MISSING`, and labctl works without; or `BROKEN`, and it does not.
        says: A version or a place, what it is for, what to do.
    """

    about: str
    name: str
    state: str
    says: str


def examine() -> tuple[Finding, ...]:
    """Look at everything; at what needs packages only where these are whole."""
    ground = (*_itself(), *_packages())
    if any(found.state == BROKEN for found in ground):
        return ground
    return (*ground, *_visa(), *_plug_ins(), *_extras(), *_data_sets(), _disk())


def _itself() -> Iterator[Finding]:
    yield Finding("labctl", "version", OK, f"{this_version()}, in {Path(labctl.__file__).parent}")
    yield Finding("labctl", "python", OK, f"{platform.python_version()} ({platform.python_implementation()})")
    yield Finding("labctl", "platform", OK, platform.platform())


def _requirements(extra: str = "") -> list[Requirement]:
    found = (Requirement(text) for text in requires(DISTRIBUTION) or ())
    return [one for one in found if ("extra" in str(one.marker)) == bool(extra) and _applies(one, extra)]


def _applies(one: Requirement, extra: str) -> bool:
    return one.marker is None or one.marker.evaluate({"extra": extra})


def _packages() -> Iterator[Finding]:
    again = f"pip install --force-reinstall {DISTRIBUTION}"
    for one in _requirements():
        problem = _problem(one)
        yield Finding(
            "package", one.name, BROKEN if problem else OK, f"{problem}: {again}" if problem else version(one.name)
        )


def _problem(one: Requirement) -> str:
    """What is wrong with a required package, empty if nothing is."""
    try:
        found = version(one.name)
        if found not in one.specifier:
            return f"{found} is installed, needed is {one.specifier}"
        import_module(MODULES.get(one.name, one.name))
    except PackageNotFoundError:
        return "is not installed"
    except IMPORT_FAILURES as error:
        return f"cannot be imported ({' '.join(str(error).split())})"
    return ""


def _visa() -> Iterator[Finding]:
    from pyvisa.highlevel import get_wrapper_class, list_backends

    support: Any = get_wrapper_class(
        "py"
    ).get_debug_info()  # kind -> a word if it is there, lines about what it lacks if not
    for kind in (*NETWORK, "ASRL INSTR", "USB INSTR"):
        available = isinstance(support.get(kind), str)
        absent = BROKEN if kind in NETWORK else MISSING
        remedy = " ".join(support[kind]) if kind in support else "not offered by pyvisa-py"
        yield Finding("VISA", kind, OK if available else absent, "by pyvisa-py" if available else remedy)
    vendors = get_wrapper_class("ivi").get_library_paths() if "ivi" in list_backends() else ()
    yield Finding("VISA", "vendor's library", OK if vendors else MISSING, ", ".join(map(str, vendors)) or VENDOR)


def _plug_ins() -> Iterator[Finding]:
    from labctl.bench.drivers import GROUP as DRIVERS
    from labctl.bench.drivers import VIRTUAL_GROUP, load
    from protocols.registry import GROUP as PROTOCOLS

    for about, group in (("driver", DRIVERS), ("protocol", PROTOCOLS)):
        points = sorted(entry_points(group=group), key=lambda point: point.name)
        yield from (_plug_in(about, point, load if group == DRIVERS else EntryPoint.load) for point in points)
        if not any(_is_own(point) for point in points):
            yield Finding(about, "all", BROKEN, f"none of labctl's own is registered: pip install {DISTRIBUTION}")
    twins = sorted(entry_points(group=VIRTUAL_GROUP), key=lambda point: point.name)
    yield from (_plug_in("virtual instrument", point, EntryPoint.load) for point in twins)


def _plug_in(about: str, point: EntryPoint, load: Callable[[EntryPoint], Any]) -> Finding:
    origin = "" if point.dist is None else point.dist.name
    try:
        found = load(point)
    except IMPORT_FAILURES as error:
        state = BROKEN if _is_own(point) else MISSING
        return Finding(about, point.name, state, f"of {origin} does not load: {' '.join(str(error).split())}")
    return Finding(about, point.name, OK, f"{getattr(found, 'role', '')} of {origin}".lstrip())


def _is_own(point: EntryPoint) -> bool:
    return point.dist is not None and point.dist.name == DISTRIBUTION


def _extras() -> Iterator[Finding]:
    for extra, purpose in EXTRAS.items():
        needed = _requirements(extra)
        present = bool(needed) and all(map(_installed, needed))
        says = purpose if present else f'{purpose}: pip install "{DISTRIBUTION}[{extra}]"'
        yield Finding("extra", extra, OK if present else MISSING, says)


def _installed(one: Requirement) -> bool:
    try:
        return version(one.name) in one.specifier
    except PackageNotFoundError:
        return False


def _data_sets() -> Iterator[Finding]:
    from labctl import datasets

    for card in datasets.catalogue():
        try:
            yield Finding("data set", card.name, OK, str(datasets.path(card.name)))
        except datasets.DatasetError:
            state = BROKEN if card.bundled else MISSING
            yield Finding("data set", card.name, state, card.obtain or f"labctl data fetch {card.name}")


def _disk() -> Finding:
    try:
        folder = Path.cwd()
    except FileNotFoundError:
        return Finding("disk", ".", BROKEN, "the present folder was removed: change into one that is there")
    return Finding("disk", str(folder), OK, f"{shutil.disk_usage(folder).free / 1e9:.1f} GB free for runs here")
