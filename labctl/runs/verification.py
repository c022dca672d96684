"""Is everything that was measured still there, and is data.h5 what the shards say?"""

import json
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray

from instruments.values import Drive
from labctl.errors import RunError
from labctl.runs.format.columns import in_this_version
from labctl.runs.format.journal import held, read_journal
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import SUSPECT, Manifest
from labctl.runs.format.own_files import own_file, place_of, read_own, require_own_files
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, attribute, check_plain, walked
from labctl.runs.format.plan import names_its_manifest, read_drive, read_plan
from labctl.runs.format.shard import MOST_BYTES as MOST_OF_A_SHARD
from labctl.runs.format.shards import Shards
from labctl.runs.format.version import FORMAT_VERSION
from labctl.runs.notes import read_notes
from labctl.runs.read.data_file import MOST_BYTES, damaged
from labctl.runs.write.data_file import (
    SCALES,
    attached,
    attributes_in,
    constants,
    shard_in_data_file,
    write_data_file,
)


@dataclass(frozen=True)
class Damage:
    """Where a run is damaged: a file in its directory, and the first and last byte that are not what they were.

    Where the place is not known more closely it is the whole file; `last` is None for one that is missing.
    """

    file: str
    first: int
    last: int | None


@dataclass(frozen=True)
class Problem:
    """What is wrong, in words, and where."""

    text: str
    damage: Damage | None = None


@dataclass(frozen=True)
class RunReport:
    """What `verify_run` found.

    Attributes:
        path: the run directory.
        complete: every planned shot is there and intact.
        shots: how many shots are intact on all passes, and not in doubt.
        suspect: how many records, shots of one pass, are intact but in doubt.
        planned: how many were planned.
        passes: how many intact shots each pass has.
        shards: how many shards are intact.
        data_file: whether data.h5 holds what the shards hold; "stale" is one made before the run was resumed.
        problems: what is wrong, a line each. An incomplete run is no problem.
        damaged: the first place in it that is damaged; manifest, plan, journal, shards and data.h5 in this order.
        notes: what is worth knowing: traces of a crash, a missing data.h5.
    """

    path: str
    complete: bool = False
    shots: int = 0
    suspect: int = 0
    planned: int = 0
    passes: tuple[int, ...] = ()
    shards: int = 0
    data_file: Literal["current", "stale", "missing", "damaged"] = "missing"
    problems: tuple[str, ...] = ()
    damaged: Damage | None = None
    notes: tuple[str, ...] = ()

    @property
    def intact(self) -> bool:
        """Whether nothing is wrong; shots may be missing still."""
        return not self.problems


def verify_run(path: Path | str, *, rebuild: bool = False) -> RunReport:
    """Check the manifest, the plan, every line of the journal, every shard, and data.h5 against the shards.

    `rebuild` makes data.h5 anew first, unless a shard is damaged: then the old data.h5 may be the last copy.

    Raises:
        RunInUse: `rebuild` of a run that another process is writing, or is making the data.h5 of.
        RunError: not a run directory at all, or `rebuild` finds the disk full.

    Example:
        >>> from labctl.runs.verification import verify_run
        >>> report = verify_run("runs/mine")
        >>> report.intact, report.complete, report.passes, report.data_file
        (True, True, (220, 220), 'current')
    """
    paths = RunPaths(Path(path))
    if not paths.manifest.exists():
        raise RunError(f"{paths.directory}: not a run directory (no manifest.json in it)")
    require_own_files(paths.directory)
    with held(paths.journal) if rebuild and paths.journal.exists() else nullcontext():
        return _verified(str(path), paths, rebuild=rebuild)


def _verified(path: str, paths: RunPaths, *, rebuild: bool) -> RunReport:
    at = paths.manifest
    try:
        manifest = Manifest.read(paths)
        at = paths.plan
        plan, drive = read_plan(paths, manifest.values["plan_sha256"])
        at = paths.manifest
        names_its_manifest(paths, manifest.values)
        at = paths.journal
        journal = read_journal(paths.journal)
        named = Shards(paths, manifest.shape, plan, journal.entries)
    except (RunError, KeyError) as error:
        return RunReport(path, problems=(str(error),), damaged=_whole(paths, at))
    line = journal.damaged and Damage(paths.journal.name, *journal.damaged)
    problems = [Problem(text, line) for text in journal.problems]
    problems += [Problem(text, _whole(paths, paths.journal)) for text in _measured_twice(named)]
    notes = _traces(named, torn=paths.journal.stat().st_size > journal.whole_bytes)
    lost = set()
    for number in sorted(named.entries):
        try:
            named.read(number)
        except RunError as error:
            problems.append(Problem(str(error), _in_shard(named, number)))
            lost.add(number)
    intact = Shards(paths, manifest.shape, plan, [named.entries[n] for n in named.entries if n not in lost])
    if rebuild and lost:
        notes.append("data.h5 was not rebuilt: a shard is damaged")
    elif rebuild:
        write_data_file(intact, manifest, drive)
    state, differences = _data_file(paths, manifest, drive, named, intact)
    if state == "stale" or (state == "missing" and intact.complete.size):
        notes.append(f"data.h5 is {state}: `labctl verify --rebuild` makes it from the shards")
    notes += [f"{count} records are suspect: {reason}" for reason, count in intact.suspect.items()]
    notes += _of_notes(paths)
    return RunReport(
        path=path,
        complete=intact.completed == manifest.shape.shots,
        shots=intact.completed,
        suspect=sum(intact.suspect.values()),
        planned=manifest.shape.shots,
        passes=intact.done,
        shards=len(intact.entries),
        data_file=state,
        problems=tuple(problem.text for problem in (*problems, *differences)),
        damaged=next((problem.damage for problem in (*problems, *differences)), None),
        notes=tuple(notes),
    )


def _of_notes(paths: RunPaths) -> tuple[str, ...]:
    """What is wrong with what people said of the run, which is no damage of what was measured."""
    try:
        return read_notes(paths).problems
    except RunError as error:
        return (str(error),)


def _measured_twice(shards: Shards) -> list[str]:
    measured = np.zeros((len(shards.shape.passes), shards.shape.shots), np.int64)
    for entry in shards.entries.values():
        measured[entry.pass_index, entry.first : entry.first + entry.count] += 1
    return [
        f"journal.jsonl: pass {pass_index} has shot {int(shot)} more than once"
        for pass_index, shot in np.argwhere(measured > 1)[:1]
    ]


def _traces(shards: Shards, *, torn: bool) -> list[str]:
    folder = shards.paths.shards
    notes = ["the last line of journal.jsonl is torn: a crash; `labctl resume` mends it"] if torn else []
    notes += [f"{found.name}: half-written, of no use" for found in sorted(folder.glob("*.tmp"))]
    notes += [f"{found.name}: set aside as damaged by a resume" for found in sorted(folder.glob("*.damaged"))]
    notes += [f"{found.name}: set aside as suspect, measured again" for found in sorted(folder.glob("*.suspect"))]
    known = {shards.paths.shard(number) for number in shards.entries}
    unknown = sorted(set(folder.glob("*.h5")) - known)
    of_no_use = "not in the journal, and of no use: `labctl resume` measures again what is missing of its shots"
    return notes + [f"{found.name}: {of_no_use}" for found in unknown]


def _data_file(
    paths: RunPaths, manifest: Manifest, drive: Drive | None, named: Shards, intact: Shards
) -> tuple[Literal["current", "stale", "missing", "damaged"], list[Problem]]:
    """The state of data.h5, and in what it differs from the run."""
    whole = _whole(paths, paths.data)
    if not paths.data.exists():
        return "missing", []
    try:
        with walked(paths.data) as file:
            check_plain(file, MOST_BYTES, besides="frames")
            current = attribute(file, "evidence") == named.evidence
            kept = json.loads(attribute(file, "manifest"))
            # A resumed run says in its manifest what is in doubt, or no longer is, before it makes data.h5 anew.
            expected = manifest if current else manifest.with_suspect(kept.get(SUSPECT, {}))
            text = f"{paths.data}: the manifest in it is not manifest.json"
            differences = [] if kept == dict(expected.values) else [Problem(text, whole)]
            differences += _different_constants(file, drive, intact)
            if current and manifest.values["format_version"] == FORMAT_VERSION:  # others say less, or otherwise
                differences += _different_attributes(file, named)
        with own_file(paths.data) as stored, h5py.File(place_of(stored, paths.data), "r") as file:
            if current:  # else shots of it may have been measured again since it was made
                differences += _different_columns(file, intact)
            for name, index in (("shots.index", file["shots"]["index"]), ("shot", file["shot"][:])) if current else ():
                if not np.array_equal(index, named.complete):
                    text = f"{paths.data}: /{name} is not the list of complete shots"
                    differences.append(Problem(text, _in_dataset(paths, file[name.partition(".")[0]])))
    except HDF5_ERRORS as error:
        return "damaged", [Problem(str(damaged(paths.data, error)), whole)]
    if differences:
        return "damaged", differences
    return ("current" if current else "stale"), []


def _different_constants(file: h5py.File, drive: Drive | None, shards: Shards) -> list[Problem]:
    paths = shards.paths
    differences = []
    for name, values in constants(shards).items():
        expected = np.asarray(values)
        known = ~np.isnan(expected) if name in ("scale", "offset") else slice(None)
        if not np.array_equal(file[name][:][known], expected[known]):
            text = f"{paths.data}: /{name} differs from the run's"
            differences.append(Problem(text, _in_dataset(paths, file[name])))
    marked = None if drive is None else drive.marker.tobytes()
    if _drive_bytes(read_drive(file)) != _drive_bytes(drive) or (drive and file["drive/marker"][:].tobytes() != marked):
        text = f"{paths.data}: /drive differs from the planned one"
        differences.append(Problem(text, _whole(paths, paths.data)))
    return differences


def _drive_bytes(drive: Drive | None) -> tuple[bytes, str] | None:
    said = "" if drive is None else repr((drive.name, drive.sample_rate, drive.amplitude_vpp))
    return None if drive is None else (drive.samples.tobytes(), said)


def _different_attributes(file: h5py.File, shards: Shards) -> list[Problem]:
    """Compare what the file says of itself, its arrays and their axes with what it would say if it were made now."""
    expected = attributes_in(file, shards)
    owners = {owner: file[owner] for owner in expected}  # each is slow to come by
    different = [
        f"the attribute {name!r} of {owner}"
        for owner, attributes in expected.items()
        for name, value in attributes.items()
        if attribute(owners[owner], name) != value
    ]
    different += [
        f"axis {dimension} of /{name}"
        for name, dimension, axis in attached()
        if [scale.name for scale in owners[f"/{name}"].dims[dimension].values()] != [f"/{SCALES[axis]}"]
    ]
    data = shards.paths.data
    return [Problem(f"{data}: {what} is not what the run's would be", _whole(shards.paths, data)) for what in different]


def _different_columns(file: h5py.File, shards: Shards) -> list[Problem]:
    """Compare every shot that intact shards hold with its row in data.h5; the first difference of each column."""
    index: NDArray[Any] = file["shots"]["index"]
    if not np.array_equal(index, np.unique(index)):
        text = f"{shards.paths.data}: /shots.index is not ascending"
        return [Problem(text, _in_dataset(shards.paths, file["shots"]))]
    different: dict[str, Problem] = {}
    complete = shards.complete[np.isin(shards.complete, index)]
    for start in range(0, len(complete), shards.rows_per_block):
        chosen = complete[start : start + shards.rows_per_block]
        rows = np.searchsorted(index, chosen)
        window = slice(int(rows[0]), int(rows[-1]) + 1)
        for name, expected in shards.block(chosen).items():
            found = file[name][window][rows - rows[0]]
            if name == "shots":
                found = in_this_version(found)
            equal = np.array([a.tobytes() == b.tobytes() for a, b in zip(found, expected, strict=True)])
            if not equal.all():
                place = int(np.argmin(equal))
                text = f"{shards.paths.data}: /{name} differs from the shards at shot {chosen[place]}"
                different.setdefault(name, Problem(text, _in_dataset(shards.paths, file[name], int(rows[place]))))
    return list(different.values())


def _whole(paths: RunPaths, path: Path) -> Damage:
    last = max(path.stat().st_size - 1, 0) if path.exists() else None
    return Damage(path.relative_to(paths.directory).as_posix(), 0, last)


def _in_shard(shards: Shards, number: int) -> Damage:
    """Where a damaged shard differs from what it was, if data.h5 still has all that was in it."""
    whole = _whole(shards.paths, shards.paths.shard(number))
    try:
        expected = shard_in_data_file(shards, shards.entries[number])
        found = read_own(shards.paths.shard(number), MOST_OF_A_SHARD)
    except (OSError, RunError):
        return whole
    if expected is None:
        return whole
    length = max(len(found), len(expected))
    sides = [np.frombuffer(bytes(side).ljust(length, b"\0"), np.uint8) for side in (found, expected)]
    different = np.flatnonzero(sides[0] != sides[1])
    if len(found) != len(expected):
        different = np.append(different, [min(len(found), len(expected)), length - 1])
    return Damage(whole.file, int(different.min()), int(different.max()))


def _in_dataset(paths: RunPaths, dataset: h5py.Dataset, row: int | None = None) -> Damage:
    """The bytes of a data set in data.h5, or of the chunk or the row of it that has `row`."""
    if row is not None and dataset.chunks:
        first_row = row // dataset.chunks[0] * dataset.chunks[0]
        chunk = dataset.id.get_chunk_info_by_coord((first_row, *(0,) * (dataset.ndim - 1)))
        first, size = chunk.byte_offset, chunk.size
    elif dataset.id.get_offset() is None:
        return _whole(paths, paths.data)
    else:
        size = dataset.nbytes if row is None else dataset.nbytes // len(dataset)
        first = dataset.id.get_offset() + (row or 0) * size
    return Damage(paths.data.name, first, first + size - 1)
