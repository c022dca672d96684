"""What a killed process may leave behind, and what it must."""

import json
import shutil
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import h5py

from labctl.runs.format.journal import read_journal
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from tests.kills.lives import Kind, Life

LATE_S = 0.5
"""A shard that is due by age is written by a thread of its own; so long may a busy machine let that thread wait."""


@dataclass
class Figures:
    """What is counted. `findings` are the lines of what must not be.

    latest_s: how much later than its age allows a shard's write began, or had not begun at the kill, at most.
    longest_write_s: of one shard.
    """

    kills: int = 0
    runs: int = 0
    acknowledged: int = 0
    lost: int = 0
    most_lost: int = 0
    lost_beyond: int = 0
    unreadable: int = 0
    not_equal: int = 0
    latest_s: float = 0.0
    longest_write_s: float = 0.0
    stages: dict[str, Counter[str]] = field(default_factory=dict)
    findings: list[str] = field(default_factory=list)


def on_disk(directory: Path) -> int:
    """Records that the journal names, which must be those the run began with and no others.

    Those in doubt count, also where they were set aside to be measured again: they are marked, and not lost.

    Raises:
        ValueError: there are gaps.
    """
    paths = RunPaths(directory)
    held = {entry.shard: entry for entry in read_journal(paths.journal).entries}
    stored = {
        (entry.pass_index, shot)
        for entry in held.values()
        if not entry.discarded or paths.shard(entry.shard).with_suffix(".h5.suspect").exists()
        for shot in range(entry.first, entry.first + entry.count)
    }
    of_last = [shot for pass_index, shot in stored if pass_index == max(stored)[0]]
    if stored and len(of_last) != max(of_last) + 1:
        raise ValueError(f"{directory}: the journal has gaps before shot {max(of_last)} of pass {max(stored)[0]}")
    return len(stored)


def unreadable(directory: Path) -> list[str]:
    """Why a file of a run directory cannot be read, a line each; what a crash left half-written has no name yet."""
    found = []
    for path in sorted(directory.rglob("*")):
        try:
            if path.suffix == ".h5":
                with h5py.File(path, "r") as file:
                    file.visititems(lambda _name, item: item[()] if isinstance(item, h5py.Dataset) else None)
            elif path.suffix == ".json":
                json.loads(path.read_bytes())
            elif path.suffix == ".log":
                path.read_text(encoding="utf-8")
        except (*HDF5_ERRORS, UnicodeDecodeError) as error:
            found.append(f"{path}: {error}")
    return found + list(verify_run(directory).problems) if RunPaths(directory).manifest.exists() else found


def stage(directory: Path, life: Life, *, first: bool, records: int) -> str:
    """What a life was at when it was killed."""
    done = life.told.done[-1][1] if life.told.done else None
    if done is None:
        if not first:
            return "resume, before a shot"
        return "ranging" if RunPaths(directory).manifest.exists() else "start"
    if done < records:
        resumed = "" if first else "resume, "
        return f"{resumed}pass {1 if done < records // 2 else 2}"
    return "data.h5" if not RunPaths(directory).data.exists() else "end"


def check_killed(figures: Figures, kind: Kind, directory: Path, life: Life, before: int) -> int:
    """Compare what lies on disk with what the killed `life` reported as done; returns how many records do.

    `before`: records that were on disk when it began. A run that has no manifest yet is cleared away, as its operator
    is told to, if nothing was reported.
    """
    figures.findings += (lines := unreadable(directory))
    figures.unreadable += len(lines)
    reported = life.told.done[-1][1] if life.told.done else before
    figures.acknowledged += reported - before
    if not RunPaths(directory).manifest.exists():
        if reported:
            figures.lost_beyond += reported
            figures.findings.append(f"{directory}: {reported} records were reported and there is no manifest")
        shutil.rmtree(directory, ignore_errors=True)
        return 0
    there = on_disk(directory)
    lost = max(reported - there, 0)
    figures.lost += lost
    figures.most_lost = max(figures.most_lost, lost)
    allowed = kind.durability.shots if kind.protocol.timing == "software" else 0
    if lost > allowed or there < before:
        figures.lost_beyond += max(lost - allowed, before - there)
        figures.findings.append(f"{directory}: {there} records on disk, {reported} reported, {before} there before")
    for begun, ended in life.told.writes:
        if ended < float("inf"):
            figures.longest_write_s = max(figures.longest_write_s, ended - begun)
    if lost:
        late = _late_s(kind, life, there)
        figures.latest_s = max(figures.latest_s, late)
        if late > LATE_S:
            figures.lost_beyond += lost
            figures.findings.append(f"{directory}: {lost} records lost, the first due {late:.2f} s before the kill")
    return there


def _late_s(kind: Kind, life: Life, there: int) -> float:
    """How long the first record that is not on disk was overdue when its write began, or at the kill."""
    reported = next(moment for moment, done in life.told.done if done > there)
    due = reported + kind.durability.seconds
    begun = min((begun for begun, ended in life.told.writes if begun > reported), default=life.ended)
    return max(begun - due, 0.0)


def check_ended(figures: Figures, directory: Path, digest: str) -> None:
    """Compare a run that came to its end with one that was never interrupted; what was in doubt lies set aside."""
    figures.runs += 1
    report = verify_run(directory)
    with open_run(directory) as run:
        found = run.digest()
    figures.findings += (lines := unreadable(directory))
    figures.unreadable += len(lines)
    noted = [note for note in report.notes if not note.endswith("set aside as suspect, measured again")]
    if not (report.complete and report.data_file == "current" and not noted and found == digest):
        figures.not_equal += 1
        figures.findings.append(f"{directory}: frames {found}, {report}; an uninterrupted run has {digest}")
