"""What a run says of itself when it is published, its faults first."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import Manifest, protocol_settings
from labctl.runs.format.origin import Origin
from labctl.runs.notes import Notes, read_notes
from labctl.runs.verification import RunReport, verify_run

NOT_REAL: Mapping[Origin, tuple[str, str]] = {
    Origin.SIMULATED: ("Simulated", "made by the simulated bench of labctl, not measured on real instruments"),
    Origin.MIXED: ("Partly simulated", "some of its instruments were simulated by labctl, the others were real"),
    Origin.REPLAYED: ("Replayed", "made from a recording of instruments, be they real or simulated, not measured anew"),
}
"""What a run is called that is not of a real bench, and what that means."""


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
    def kind(self) -> str:
        """What it is: a measurement, or one that is not, or not wholly, of real instruments."""
        origin = Origin.of(self.values)
        return f"{NOT_REAL[origin][0]} measurement" if origin in NOT_REAL else "Measurement"

    @property
    def faults(self) -> list[str]:
        """What whoever uses it must know before anything else, a sentence each."""
        report, faults = self.report, []
        if (origin := Origin.of(self.values)) in NOT_REAL:
            mark, meaning = NOT_REAL[origin]
            faults.append(f"{mark.upper()}: {meaning}.")
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
