"""What a run says of itself when it is published, its faults first."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest, protocol_settings
from labctl.runs.notes import Notes, read_notes
from labctl.runs.verification import RunReport, verify_run


@dataclass(frozen=True)
class Subject:
    """A run that was verified just now.

    Attributes:
        values: what manifest.json holds.
        report: what its verification found.
        notes: what people say of it.
    """

    name: str
    values: Mapping[str, Any]
    report: RunReport
    notes: Notes

    @classmethod
    def of(cls, paths: RunPaths) -> "Subject":
        """The run of some paths.

        Raises:
            RunError: not a run, or its manifest or notes cannot be read.
        """
        manifest = Manifest.read(paths)
        return cls(paths.directory.resolve().name, manifest.values, verify_run(paths.directory), read_notes(paths))

    @property
    def simulated(self) -> bool:
        """Whether any of it was measured on a simulated instrument, as far as the run says."""
        seeds, station = self.values.get("seeds", self.values), self.values.get("station")
        if isinstance(seeds, dict) and seeds.get("twin_seed") is not None:
            return True
        addresses = [one.get("address") for one in _mappings(station)]
        identities = json.dumps([identity for _, identity in self.instruments])
        return "simulated" in addresses or "simulated" in identities.lower() or '"SIM' in identities

    @property
    def faults(self) -> list[str]:
        """What whoever uses it must know before anything else, a sentence each."""
        report, faults = self.report, []
        if self.simulated:
            faults.append("SIMULATED: made by the simulated bench of labctl, not measured on real instruments.")
        if not report.intact:
            faults.append(f"DAMAGED: {'; '.join(report.problems)}.")
        if not report.complete:
            faults.append(f"UNFINISHED: {report.shots} of {report.planned} shots are there and intact.")
        if report.suspect:
            faults.append(f"IN DOUBT: {report.suspect} records are marked as suspect.")
        return faults

    @property
    def marks(self) -> str:
        """The first words of the faults, as they stand before its title; empty for a run without."""
        return "".join(f"[{fault.partition(':')[0]}] " for fault in self.faults)

    @property
    def protocol(self) -> tuple[str, Mapping[str, Any]]:
        """Name and settings of its protocol."""
        found = self.values.get("protocol")
        name = found.get("name", "") if isinstance(found, dict) else found
        return str(name or "unknown"), protocol_settings(self.values)

    @property
    def started(self) -> str:
        """When it was begun, ISO 8601, empty where it does not say."""
        return str(self.values.get("started", ""))

    @property
    def instruments(self) -> list[tuple[str, Mapping[str, Any]]]:
        """The identity of each instrument, by its role."""
        found = self.values.get("instruments")
        said = found.items() if isinstance(found, dict) else ()
        return [
            (str(role), one["identity"])
            for role, one in said
            if isinstance(one, dict) and isinstance(one.get("identity"), dict)
        ]

    @property
    def software(self) -> str:
        """Version of labctl that measured it, with the git revision where it is known."""
        versions = self.values.get("versions")
        version = versions.get("photonic-labctl", "") if isinstance(versions, dict) else ""
        revision = self.values.get("git_revision")
        return f"{version}{f', git {revision}' if revision else ''}"

    def description(self, said: str) -> str:
        """The faults, what somebody said of it, and what it is."""
        shots = f"{self.report.shots} shots" if self.report.planned else "Shots"
        what = f"{shots} of the protocol {self.protocol[0]}, measured by labctl {self.software}, begun {self.started}."
        return " ".join((*self.faults, said, what) if said else (*self.faults, what))


def _mappings(found: object) -> Iterator[Mapping[str, Any]]:
    for one in found.values() if isinstance(found, dict) else ():
        if isinstance(one, dict):
            yield one
