"""Whether records come from a bench, the simulated one, one that is simulated in part, or a recording of any."""

from collections.abc import Iterable, Mapping
from enum import StrEnum
from pathlib import Path
from typing import Any, Self

from instruments.sections import SIMULATED, USB
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import REPLAY, Manifest

SERIAL = "SIM"
"""What the serial number of an instrument of a simulated bench begins with, wherever it is served."""
BEHIND_USB = frozenset({"vialux-alp", "ti-dlpc900"})
"""Drivers of instruments with a serial number of their own, or none, that are real where they are behind USB."""


class Origin(StrEnum):
    """Where records come from."""

    REAL = "real"
    MIXED = "mixed"
    SIMULATED = "simulated"
    REPLAYED = "replayed"

    @classmethod
    def of(cls, manifest: Mapping[str, Any]) -> Self:
        """By the addresses and identities in a manifest; instruments that a person sets do not count."""
        if manifest.get(REPLAY):
            return cls(cls.REPLAYED)
        station, instruments = (_mapping(manifest.get(name)) for name in ("station", "instruments"))
        simulated = {
            _simulated(_mapping(station.get(role)), identity)
            for role, one in instruments.items()
            if any((identity := _mapping(_mapping(one).get("identity"))).get(key) for key in ("manufacturer", "serial"))
        }
        return cls.together(cls.SIMULATED if one else cls.REAL for one in simulated)

    @classmethod
    def together(cls, origins: Iterable["Origin"]) -> Self:
        """Of what was made of records of several origins."""
        found = set(origins)
        return cls(found.pop() if len(found) == 1 else cls.MIXED if found else cls.REAL)

    @classmethod
    def of_runs(cls, directories: Iterable[Path]) -> Self:
        """Of what was made of several runs.

        Raises:
            RunError: One of them is none, or its manifest is damaged.
        """
        return cls.together(cls.of(Manifest.read(RunPaths(directory)).values) for directory in directories)


def _simulated(section: Mapping[str, Any], identity: Mapping[str, Any]) -> bool:
    address, driver = section.get("address"), section.get("driver")
    served = driver in BEHIND_USB and address != USB
    return address == SIMULATED or served or str(identity.get("serial")).startswith(SERIAL)


def _mapping(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}
