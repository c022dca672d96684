"""What a bench answered to the questions that documents leave open, kept beside its calibrations with its date."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from pydantic import AwareDatetime, BaseModel, ConfigDict, ValidationError

from instruments.values import Answer
from labctl.bench.calibration import LARGEST, bench_of, folder_of, latest, new_folder
from labctl.bench.station import Station
from labctl.errors import writing
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.own_files import read_own

FILE = "answers.json"
FORMAT_VERSION = "1.0"


class Stored(BaseModel):
    """What `answers.json` holds."""

    model_config = ConfigDict(frozen=True)

    format_version: str
    date: AwareDatetime
    bench: dict[str, object]
    answers: list[Answer]


def save(station: Station, answers: Sequence[Answer], started: datetime) -> Path:
    """Write `answers.json` into a new folder beside the calibrations of the bench, all or nothing; returns its path.

    Raises:
        RunError: it cannot be written.
    """
    folder = new_folder(station, started)
    with writing(folder, "name another folder as calibration.folder"):
        folder.mkdir(parents=True, exist_ok=True)
    content = {
        "format_version": FORMAT_VERSION,
        "date": started.isoformat(timespec="seconds"),
        "bench": bench_of(station),
        "answers": [asdict(answer) for answer in answers],
    }
    path = folder / FILE
    replace_file(path, (json.dumps(content, indent=1) + "\n").encode(), not_made)
    return path


def warnings(station: Station) -> list[str]:
    """What to warn of before light is switched on: where the bench did not answer as labctl assumes, a line each."""
    read = {path: stored for path in folder_of(station).glob(f"*/{FILE}") if (stored := _read(path)) is not None}
    found = {path: stored for path, stored in read.items() if stored.bench == bench_of(station)}
    path, lines = latest({path: stored.date for path, stored in found.items()}, datetime.now(UTC))
    if path is None:
        return lines
    return lines + [
        f"{path}: {answer.question}: {answer.found}, not {answer.assumed} as is assumed: see to it, and repeat "
        "'labctl check --deep'"
        for answer in found[path].answers
        if not answer.agrees
    ]


def _read(path: Path) -> Stored | None:
    """What a file holds, if it is of this kind and of a version that this labctl reads."""
    try:
        stored = Stored.model_validate_json(read_own(path, LARGEST))
    except (OSError, ValidationError):
        return None
    return stored if stored.format_version.split(".")[0] == FORMAT_VERSION.split(".")[0] else None
