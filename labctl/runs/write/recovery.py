"""Putting a run in order after a crash, before it goes on."""

import re
from dataclasses import replace
from pathlib import Path

from labctl.errors import RunError, ShardLost
from labctl.runs.format.durable import not_written, replace_file, sync_folder
from labctl.runs.format.journal import NOT_COMPARED, Entry, JournalFile
from labctl.runs.format.own_files import read_own
from labctl.runs.format.shard import MOST_BYTES, Shard
from labctl.runs.format.shards import Shards
from labctl.runs.write.data_file import shard_in_data_file


def recover(shards: Shards, journal: JournalFile) -> tuple[tuple[str, ...], int]:
    """Make disk and journal agree; returns what was found, a line each, and the number of the next shard.

    A shard that the journal names but that is missing or damaged is made again from data.h5. Where data.h5 has it not,
    it is set aside as `.damaged` and discarded in the journal: its shots are to be measured again. So is one that is in
    doubt, as `.suspect`; and so is a whole shard that the journal does not name, because the process died between
    renaming it and writing the line: nobody knows whether its settings were compared. Half-written files go.

    Raises:
        RunError: a shard cannot be read, whatever is in it, and nothing was changed; or the disk is full or refuses.
    """
    folder = shards.paths.shards
    for renamed_in in (shards.paths.directory, folder):
        _keep_names(renamed_in)
    found = [
        *_restore_lost(shards, journal),
        *_name_unnamed(shards, journal),
        *discard_suspect(shards, journal),
    ]
    for half_written in [*folder.glob("*.tmp"), *shards.paths.directory.glob("*.tmp")]:
        if half_written.is_file():
            half_written.unlink()
            found.append(f"{half_written.name}: half-written, removed")
    return tuple(found), max(_numbers(shards), default=-1) + 1


def _keep_names(folder: Path) -> None:
    """A killed process may have renamed a file that the journal is about to name, and not made the name durable."""
    try:
        sync_folder(folder)
    except OSError as error:
        raise not_written(folder, error) from error


def discard_suspect(shards: Shards, journal: JournalFile) -> list[str]:
    """Set aside what is in doubt, so that it is measured again; returns what was found, a line each.

    Raises:
        RunError: the disk is full or refuses.
    """
    found = []
    for entry in [entry for entry in shards.entries.values() if entry.suspect]:
        _set_aside(shards, journal, entry, "suspect", entry.suspect)
        found.append(f"{entry.count} shots are suspect ({entry.suspect}): they are to be measured again")
    return found


def _restore_lost(shards: Shards, journal: JournalFile) -> list[str]:
    """Make missing and damaged shards again from data.h5, which may be the last copy, or discard them."""
    found = []
    for entry in _lost(shards):
        path = shards.paths.shard(entry.shard)
        if (image := shard_in_data_file(shards, entry)) is not None:
            replace_file(path, image)
            found.append(f"{path}: was missing or damaged, and is made again from data.h5")
        else:
            _set_aside(shards, journal, entry, "damaged", "missing or damaged")
            found.append(f"{path}: missing or damaged: its {entry.count} shots are to be measured again")
    return found


def _lost(shards: Shards) -> list[Entry]:
    """Those of the journal's shards that are missing or damaged.

    Raises:
        RunError: one of them cannot be read: nobody knows what is in it.
    """
    lost = []
    for number, entry in sorted(shards.entries.items()):
        try:
            shards.image(number)
        except ShardLost:
            lost.append(entry)
    return lost


def _set_aside(shards: Shards, journal: JournalFile, entry: Entry, state: str, reason: str) -> None:
    """Take a shard back in the journal, and rename its file if there is one: what was measured is not thrown away."""
    line = replace(entry, discarded=reason, suspect="", shots=0)
    journal.append(replace(line, shots=shards.add(line)))
    path = shards.paths.shard(entry.shard)  # renamed after the line: what the journal names is always there
    try:
        if path.exists():
            path.replace(path.with_suffix(f".h5.{state}"))
            sync_folder(path.parent)
    except OSError as failure:
        raise not_written(path, failure) from failure


def _name_unnamed(shards: Shards, journal: JournalFile) -> list[str]:
    found = []
    for path in sorted(shards.paths.shards.glob("*.h5")):
        number = int(path.stem) if path.stem.isdecimal() else -1
        if number < 0 or number in shards.entries:
            continue
        try:
            image = read_own(path, MOST_BYTES)
            shard = Shard.decode(image, shards.shape, str(path))
        except (OSError, RunError) as error:
            found.append(f"{error}; the journal does not name it, ignored")
            continue
        if shards.has(shard.pass_index, shard.first, len(shard.rows)):
            found.append(f"{path}: the journal does not name it and has its shots, ignored")
            continue
        entry = shards.entry(number, shard.pass_index, shard.first, len(shard.rows), image, NOT_COMPARED)
        journal.append(entry)
        shards.add(entry)
        found.append(f"{path}: was not in the journal yet")
    return found


def _numbers(shards: Shards) -> set[int]:
    """Every shard number in use, by a file of any state or by the journal."""
    names = (re.match(r"\d+", path.name) for path in shards.paths.shards.iterdir())
    return {int(name[0]) for name in names if name} | set(shards.entries)
