"""The calibration of a bench: what an alignment found, with its date, and whether it still holds for the bench.

A folder for each alignment: `calibration.json` beside its pictures. A run refers to the one that was the newest of its
bench when it was begun.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from pydantic import AwareDatetime, BaseModel, ConfigDict, ValidationError

from labctl.bench.station import Station
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.own_files import read_own

FILE = "calibration.json"
FORMAT_VERSION = "1.0"
LARGEST = 1 << 20
"""Bytes; a calibration has some ten thousand."""
SET_ASIDE = ("timeout", "armed", "commands", "library")
"""Keys that change nothing of what is measured, or name a file in whatever way the station's own was named."""


class Stored(BaseModel):
    """What `calibration.json` holds."""

    model_config = ConfigDict(frozen=True)

    format_version: str
    date: AwareDatetime
    good: bool
    bench: dict[str, Any]
    settings: dict[str, dict[str, Any]]
    instruments: dict[str, Any]
    findings: list[dict[str, Any]]


@dataclass(frozen=True)
class Calibration:
    """A calibration as it was found on disk: its file, the SHA-256 of that, and what is in it."""

    path: Path
    sha256: str
    stored: Stored

    def reference(self) -> dict[str, Any]:
        """What a run keeps of it."""
        return {
            "path": str(self.path),
            "sha256": self.sha256,
            "date": self.stored.date.isoformat(timespec="seconds"),
            "good": self.stored.good,
        }


def folder_of(station: Station) -> Path:
    """Where the calibrations of a station are: beside its file, or in the present folder if it has none."""
    source = Path(station.source)
    return (source.parent if source.is_file() else Path()) / station.calibration.folder


def new_folder(station: Station, started: datetime) -> Path:
    """Where an alignment goes that names no directory of its own."""
    name = "".join(letter if letter.isascii() and letter.isalnum() else "-" for letter in station.name)
    return folder_of(station) / f"{started.strftime('%Y%m%dT%H%M%SZ')}-{name}"


def save(
    directory: Path,
    station: Station,
    findings: Sequence[Mapping[str, Any]],
    instruments: dict[str, Any],
    started: datetime,
) -> Path:
    """Write `calibration.json` into `directory`, all or nothing; returns its path.

    findings: what an alignment found, a map each; the calibration is good if `good` is true in all of them.

    Raises:
        RunError: It cannot be written.
    """
    stored = Stored(
        format_version=FORMAT_VERSION,
        date=started,
        good=all(finding["good"] for finding in findings),
        bench=bench_of(station),
        settings=_settings(station),
        instruments=instruments,
        findings=[dict(finding) for finding in findings],
    )
    path = directory / FILE
    replace_file(path, (stored.model_dump_json(indent=1) + "\n").encode(), not_made)
    return path


def newest(station: Station, now: datetime) -> Calibration | None:
    """The latest calibration until `now` of the bench that `station` describes; None without any that can be read."""
    found = _of_bench(station)
    path, _ = latest({path: one.stored.date for path, one in found.items()}, now)
    return found[path] if path else None


def _of_bench(station: Station) -> dict[Path, Calibration]:
    found = {path: one for path in folder_of(station).glob(f"*/{FILE}") if (one := read(path)) is not None}
    return {path: one for path, one in found.items() if one.stored.bench == bench_of(station)}


def latest(dates: Mapping[Path, datetime], now: datetime) -> tuple[Path | None, list[str]]:
    """The file with the latest date until `now`, and a warning of each dated later: it would hide all until then."""
    lines = [
        f"{path}: is dated {date.isoformat(timespec='seconds')}, which is yet to come, and is left out: check the "
        f"clock of this machine; if it was wrong then, remove that file and measure again"
        for path, date in dates.items()
        if date > now
    ]
    return max((path for path, date in dates.items() if date <= now), key=dates.__getitem__, default=None), lines


def concerns(calibration: Calibration, station: Station, now: datetime) -> list[str]:
    """Why a calibration may no longer hold for the bench, a line each, with what to do."""
    stored = calibration.stored
    reasons = []
    age = now - stored.date
    if age > timedelta(seconds=station.calibration.valid):
        reasons.append(
            f"it is {age.days} days old, more than calibration.valid = {station.calibration.valid / 86400:g} days"
        )
    present, then = _flat(_settings(station)), _flat(stored.settings)
    reasons += [
        f"{key} was {then.get(key)!r}, is {present[key]!r}"
        for key in sorted(present)  # a key that the driver no longer has cannot have changed the bench
        if present[key] != then.get(key)
    ]
    if not stored.good:
        reasons.append("not all of it was good")
    return [f"{calibration.path}: {one}: measure again with 'labctl align'" for one in reasons]


def warnings(reference: object, station: Station) -> list[str]:
    """What to warn of before light is switched on: the calibration that a run refers to may not hold any more.

    reference: as `Calibration.reference` gives it and the manifest keeps it; anything else says that there was none.
    """
    now, found = datetime.now(UTC), _of_bench(station)
    path, lines = latest({path: one.stored.date for path, one in found.items()}, now)
    if not isinstance(reference, Mapping):
        return lines
    if path is None:
        gone = "the calibration that the run refers to is not here any more"
        return [*lines, f"{folder_of(station)}: {gone}: measure again with 'labctl align'"]
    lines += concerns(found[path], station, now)
    if found[path].sha256 != reference.get("sha256"):
        lines.insert(0, f"{path}: aligned after the run was begun: look at its drift, or begin a new run")
    return lines


def read(path: Path) -> Calibration | None:
    """What a file holds, if it is a calibration that this version of labctl reads."""
    try:
        content = read_own(path, LARGEST)
        stored = Stored.model_validate_json(content)
    except (OSError, ValidationError):
        return None
    if stored.format_version.split(".")[0] != FORMAT_VERSION.split(".")[0]:
        return None
    return Calibration(path, hashlib.sha256(content).hexdigest(), stored)


def bench_of(station: Station) -> dict[str, Any]:
    """What tells one bench from another: its name, the light's way, the twin where one stands in for instruments."""
    twin = station.sim.model_dump(mode="json") if station.simulated else None
    return {"name": station.name, "projector": station.wiring.projector, "twin": twin}


def _settings(station: Station) -> dict[str, dict[str, Any]]:
    sections = {
        section: {
            key: value
            for key, value in getattr(station, section).model_dump(mode="json").items()
            if key not in SET_ASIDE
        }
        for section in (*station.roles, "wiring")
    }
    whole: dict[str, dict[str, Any]] = json.loads(json.dumps(sections))
    return whole


def _flat(settings: dict[str, dict[str, Any]]) -> dict[str, Any]:
    return {f"{section}.{key}": value for section, values in settings.items() for key, value in values.items()}
