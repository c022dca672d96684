"""A catalogue of the runs in a folder, by which one of thousands is found again.

It is a SQLite file beside the runs that holds nothing of its own: what changed since it was made is read again from the
runs, and without it, or where it is damaged or cannot be written, it is made anew. Of runs elsewhere it lies in the
user's cache.
"""

import gc
import hashlib
import json
import math
import os
import sqlite3
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import partial
from operator import itemgetter
from pathlib import Path
from typing import Any, TypeVar

from platformdirs import user_cache_path

from labctl.errors import RunError, UsageError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import protocol_settings
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import StorePath
from labctl.runs.index import RunRow, is_running, is_there, row_and_values, run_directories
from labctl.runs.live.alarm import may_emit
from labctl.runs.notes import Notes, read_notes
from labctl.runs.search import condition, unknown, words_in

FILE = "catalogue.sqlite"
APPLICATION, VERSION = 0x6C616263, 3
"""What the file says of itself and of its tables: one of another version is made anew, any other is let alone."""
LISTED = ("name", "protocol", "started", "seed", "twin_seed", "shots", "planned", "instruments", "state", "problem")
"""Keys that are attributes of `RunRow`."""
MANIFEST = b"manifest.json"
STAMPED = (MANIFEST, b"journal.jsonl", b"notes.jsonl", b"models", b"events.jsonl")
"""Files of a run that the catalogue is made of."""
MOST_VALUES = 64
"""Of one setting that is a list."""
LONGEST_VALUE = 4000
AT_ONCE = 16
"""Runs elsewhere that are read side by side."""
DAMAGED = (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_ERROR)
"""What SQLite says where the file is not as it was made; where there is no room, it says something else."""
_TABLES = f"""
    BEGIN IMMEDIATE;
    DROP TABLE IF EXISTS run;
    DROP TABLE IF EXISTS fact;
    PRAGMA application_id = {APPLICATION};
    PRAGMA user_version = {VERSION};
    CREATE TABLE run (name BLOB PRIMARY KEY, stamp TEXT, row TEXT, facts TEXT, words TEXT);
    CREATE TABLE fact (run BLOB, key TEXT, number REAL, text TEXT COLLATE NOCASE);
    CREATE INDEX fact_of_run ON fact (run, key);
"""
Facts = Mapping[str, Sequence[str | float]]
Answer = TypeVar("Answer")


@dataclass(frozen=True)
class Found:
    """A run that was found, and what is known of it: key -> every value."""

    row: RunRow
    facts: Facts


class Catalogue:
    """The runs in a folder, as they are when it is asked."""

    def __init__(self, folder: Path, rests: float = 0.0, only: Collection[str] | None = None) -> None:
        """Of the runs in `folder`, which need not exist yet.

        only: names of those that are found; None for all.

        rests: it looks at the runs again only after so many times as long as looking took. Of a folder elsewhere it
        looks once: what is known of that is how it was listed.
        """
        self._folder = folder
        self._rests = rests
        self._only = None if only is None else json.dumps(sorted(only))
        self._due = 0.0
        self._in_memory: sqlite3.Connection | None = None

    def find(
        self, *words: str, sort: str = "started", limit: int | None = None, shown: Sequence[str] = ()
    ) -> list[Found]:
        """The runs that all of `words` ask for, as `labctl.runs.search` reads them, the newest or largest last.

        sort: any key; of several values the largest counts. limit: the last so many. shown: keys that some run must
        have, where there is one.

        Raises:
            UsageError: the words are not understood, no run has that key, or `limit` is below 1.
        """
        return self.last(*words, sort=sort, limit=limit, shown=shown)[0]

    def last(
        self, *words: str, sort: str = "started", limit: int | None = None, shown: Sequence[str] = ()
    ) -> tuple[list[Found], int]:
        """The same, and how many there are, whatever the limit.

        Raises:
            UsageError: as `find`.
        """
        if limit is not None and limit < 1:
            raise UsageError(f"limit = {limit}: ask for one run or more")
        return self._told(partial(self._last, words, sort=sort, limit=limit, shown=shown))

    def _last(
        self, words: Sequence[str], database: sqlite3.Connection, *, sort: str, limit: int | None, shown: Sequence[str]
    ) -> tuple[list[Found], int]:
        keys = self._keys(database)
        for key in (sort, *(shown if keys else ())):
            if key not in keys.union(LISTED):
                raise unknown(key, keys.union(LISTED))
        asked = [condition(one, keys, partial(_holds_text, database)) for one in words]
        if self._only is not None:
            asked.append(("name IN (SELECT CAST(value AS BLOB) FROM json_each(?))", [self._only]))
        sql = " AND ".join(f"({one})" for one, _ in asked) or "1"
        values = [value for _, given in asked for value in given]
        largest = "(SELECT max({}) FROM fact WHERE fact.run = run.name AND fact.key = ?)"
        order = f"{largest.format('number')} DESC, {largest.format('text')} DESC, name DESC"
        # Names alone are sorted, which are short; rows and facts are then looked up, in whatever order.
        chosen = database.execute(
            "SELECT name, row, facts, total, place FROM (SELECT name AS chosen, count(*) OVER () AS total, "  # noqa: S608 -- of signs that `condition` chooses
            f"row_number() OVER (ORDER BY {order}) AS place FROM run WHERE {sql} ORDER BY place LIMIT ?) "
            "CROSS JOIN run ON name = chosen",
            [sort, sort, *values, -1 if limit is None else limit],
        ).fetchall()
        if not chosen:
            return [], 0
        names, rows, facts, counts, _ = zip(*sorted(chosen, key=itemgetter(-1), reverse=True), strict=True)
        try:
            with _all_of_it_kept():
                found = map(Found, map(self._row, names, _all_of(rows)), _all_of(facts))
                return list(found), counts[0]
        except (ValueError, TypeError, KeyError) as error:
            raise _DamagedRow(str(error)) from error

    def keys(self) -> list[str]:
        """All that is known of some run, by name."""
        return sorted(self._told(self._keys))

    def _row(self, name: bytes, told: dict[str, Any]) -> RunRow:
        instruments = Origin(told["instruments"]) if told["instruments"] else None
        return RunRow(**told | {"path": self._folder / os.fsdecode(name), "instruments": instruments})

    @staticmethod
    def _keys(database: sqlite3.Connection) -> frozenset[str]:
        return frozenset(key for (key,) in database.execute("SELECT DISTINCT key FROM fact"))

    def has(self, name: str) -> bool:
        """Whether there is a run of that name; one that has come since the last look is looked at."""
        if self._knows(name):
            return True
        if isinstance(self._folder, StorePath) or not is_there(RunPaths(self._folder / name).manifest):
            return False
        self.look_again()
        return self._knows(name)

    def _knows(self, name: str) -> bool:
        wanted = [os.fsencode(name)]
        return self._told(
            lambda database: bool(database.execute("SELECT 1 FROM run WHERE name = ?", wanted).fetchone())
        )

    def look_again(self) -> None:
        """Rest no longer: look at the runs when the next question comes."""
        self._due = 0.0

    def _told(self, question: Callable[[sqlite3.Connection], Answer]) -> Answer:
        """What the tables say when they are as the runs are now; in memory where the file is of no use.

        A file that is damaged is removed, so that it is made anew.
        """
        path, damaged = _kept_for(self._folder), False
        if self._in_memory is None and path.parent.is_dir() and _may_be_ours(path):
            with suppress(sqlite3.Error), closing(sqlite3.connect(path, timeout=1.0)) as database:
                self._with_tables(database)
                try:
                    return self._of_now(database, question)
                except sqlite3.Error as error:
                    damaged = getattr(error, "sqlite_errorcode", 0) & 0xFF in DAMAGED
                    raise
        if damaged:
            with suppress(OSError):
                path.unlink()
        memory = self._in_memory or sqlite3.connect(":memory:", check_same_thread=False)
        if self._rests:
            self._in_memory = memory
        with nullcontext() if self._rests else closing(memory):
            return self._of_now(self._with_tables(memory), question)

    def _with_tables(self, database: sqlite3.Connection) -> sqlite3.Connection:
        """A transaction of the database begins; where it had no tables of ours, the runs are due to be looked at."""
        (application,), (version,) = (
            database.execute(f"PRAGMA {what}").fetchone() for what in ("application_id", "user_version")
        )
        if application != APPLICATION and database.execute("SELECT 1 FROM sqlite_master").fetchone():
            raise sqlite3.DatabaseError("is of another program")
        if (application, version) == (APPLICATION, VERSION):
            database.execute("BEGIN IMMEDIATE")  # or another process writes it, or nobody can
        else:
            database.executescript(_TABLES)
            self._due = 0.0
        return database

    def _of_now(self, database: sqlite3.Connection, question: Callable[[sqlite3.Connection], Answer]) -> Answer:
        """The tables are refreshed in the transaction that opening them has begun."""
        with database:
            began = time.monotonic()
            if began >= self._due:
                self._refresh(database)
                took = time.monotonic() - began
                self._due = math.inf if isinstance(self._folder, StorePath) else began + (1 + self._rests) * took
        return question(database)

    def _refresh(self, database: sqlite3.Connection) -> None:
        entries = database.execute(
            "SELECT name, stamp, row ->> 'running', row ->> 'problem' = '' AND row ->> 'shots' = row ->> 'planned' "
            "FROM run"
        )
        known = {name: (stamp, bool(running), bool(complete)) for name, stamp, running, complete in entries}
        there = _stamps_elsewhere(self._folder) if isinstance(self._folder, StorePath) else _stamps(self._folder)
        for name in known.keys() - there.keys():
            _forget(database, name)
        changed: list[tuple[bytes, str | None, RunPaths]] = []
        for name, stamp in there.items():
            before, running, complete = known.get(name, (None, False, False))
            unchanged = stamp is not None and stamp == before
            if unchanged and complete:
                continue
            paths = RunPaths(self._folder / os.fsdecode(name))
            if not (unchanged and running == is_running(paths)):
                changed.append((name, stamp, paths))
        with _several_at_once(self._folder) as each:
            for (name, stamp, _), (row, facts) in zip(
                changed, each(_known_of, [one[2] for one in changed]), strict=True
            ):
                _forget(database, name)
                # What cannot be read may be mended where no stamp shows it: it is read again at the next look.
                _enter(database, name, None if row.problem else stamp, row, facts)


class _DamagedRow(sqlite3.DatabaseError):
    """A row that labctl has not written."""

    sqlite_errorcode = sqlite3.SQLITE_CORRUPT


@contextmanager
def _all_of_it_kept() -> Iterator[None]:
    """Nothing that the block makes is garbage: looking for some again and again takes half as long as making it."""
    looked_for = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if looked_for:
            gc.enable()


def _all_of(told: Sequence[str]) -> list[dict[str, Any]]:
    """Of JSON objects; ten thousand of them take half as long at once."""
    found: list[dict[str, Any]] = json.loads(f"[{','.join(told)}]")
    return found


def _may_be_ours(path: Path) -> bool:
    return not path.is_symlink() and (path.is_file() or not path.exists())


def _stamps(folder: Path) -> dict[bytes, str | None]:
    """The run directories in a folder: name -> what changes whenever a file does that the catalogue is made of."""
    found: dict[bytes, str | None] = {}
    root = os.fsencode(folder)
    for name in os.listdir(root) if folder.is_dir() else ():
        stamps = []
        for file in STAMPED:
            try:
                seen = os.lstat(b"%b/%b/%b" % (root, name, file))
            except OSError:
                if file == MANIFEST:
                    break
                stamps.append("")
            else:
                stamps.append(f"{seen.st_size} {seen.st_mtime_ns}")
        else:
            found[name] = ",".join(stamps)
    return found


def _stamps_elsewhere(folder: Path) -> dict[bytes, str | None]:
    """The same of a folder elsewhere; None where the store does not say when a file changed."""
    return {os.fsencode(directory.name): _stamp(directory) for directory in run_directories(folder)}


def _stamp(directory: Path) -> str | None:
    stamps: list[str] = []
    for file in STAMPED:
        path = directory / os.fsdecode(file)
        with suppress(FileNotFoundError):
            if not isinstance(path, StorePath) or (said := path.stamp()) is None:
                return None
            stamps.append(f"{path.name} {said}")
    return ", ".join(stamps)


def _kept_for(folder: Path) -> Path:
    """Where the catalogue of a folder lies: in it, or for one elsewhere among what this user keeps for later."""
    if not isinstance(folder, StorePath):
        return folder / FILE
    kept = user_cache_path("labctl") / "catalogues"
    with suppress(OSError):
        kept.mkdir(parents=True, exist_ok=True)
    return kept / f"{hashlib.sha256(str(folder).encode()).hexdigest()[:32]}.sqlite"


@contextmanager
def _several_at_once(folder: Path) -> Iterator[Callable[..., Iterable[tuple[RunRow, Facts]]]]:
    """How each of several runs is read: those elsewhere side by side, since what takes long is the way there."""
    if not isinstance(folder, StorePath):
        yield map
        return
    with ThreadPoolExecutor(AT_ONCE) as pool:
        yield pool.map


def _known_of(paths: RunPaths) -> tuple[RunRow, Facts]:
    row, values = row_and_values(paths)
    return row, facts_of(paths, row, values)


def _forget(database: sqlite3.Connection, name: bytes) -> None:
    database.execute("DELETE FROM fact WHERE run = ?", [name])
    database.execute("DELETE FROM run WHERE name = ?", [name])


def _holds_text(database: sqlite3.Connection, key: str) -> bool:
    """Whether a key of some run has a value that is no number."""
    found = database.execute("SELECT 1 FROM fact WHERE key = ? AND text IS NOT NULL LIMIT 1", [key])
    return found.fetchone() is not None


def _enter(database: sqlite3.Connection, name: bytes, stamp: str | None, row: RunRow, facts: Facts) -> None:
    stored = {field: value for field, value in vars(row).items() if field != "path"} | {"path": ""}
    told = (  # a run without a star is not found by that word, which "started" begins with too
        ("" if key == "started" else key, *(f"{one:g}" if isinstance(one, float) else one for one in values))
        for key, values in facts.items()
        if any(values)
    )
    listed = f"twin {row.twin_seed} {row.shots} of {row.planned} shots"
    text = " ".join((listed, *(word for words in told for word in words)))
    entry = [name, stamp, json.dumps(stored), json.dumps(facts), f" {' '.join(words_in(text))}"]
    database.execute("INSERT INTO run VALUES (?, ?, ?, ?, ?)", entry)
    database.executemany(
        "INSERT INTO fact VALUES (?, ?, ?, ?)",
        [
            (name, key, *((value, None) if isinstance(value, float) else (None, value)))
            for key, values in facts.items()
            for value in values
        ],
    )


def facts_of(paths: RunPaths, row: RunRow, manifest: Mapping[str, Any]) -> Facts:
    """What is known of a run: how it is listed, settings, place in a sweep, what people say, how its readouts score.

    Keys are those of `labctl runs`, of the protocol's settings, of the axes of its sweep, `bench`, `station`,
    `accuracy`, `tag`, `note`, `star`, `operator`, and `alarm`: its laser did not go dark.
    Quantities are in SI units, wavelengths in nm; yes and no are 1 and 0.
    """
    found: dict[str, list[str | float]] = {}
    if not row.problem:
        station = manifest.get("station")
        for said in (manifest.get("coordinates"), protocol_settings(manifest)):
            for key, value in said.items() if isinstance(said, dict) else ():
                found[_text(key.lower())] = _values(value)
        if isinstance(station, dict):
            found["bench"], found["station"] = _values(station.get("name")), _values(station.get("source"))
        found["accuracy"] = _accuracies(paths.readouts)
    for key in LISTED:
        found[key] = _values(getattr(row, key))
    with suppress(ValueError):
        found["started"] = [datetime.fromisoformat(row.started).astimezone(UTC).isoformat()]
    try:
        notes = read_notes(paths)
    except RunError:
        notes = Notes()
    found["tag"], found["note"] = _values(notes.tags), _values([one.text for one in notes.notes])
    found["star"], found["operator"] = [float(notes.star)], _values(notes.operator)
    found["alarm"] = [float(may_emit(paths.directory))]
    return {key: values for key, values in found.items() if values}


def _values(value: Any) -> list[str | float]:
    """A setting as numbers and text: nothing for None and no text, every element of a list."""
    if isinstance(value, bool | int | float):
        with suppress(OverflowError):
            return [number] if math.isfinite(number := float(value)) else []
    if isinstance(value, str):
        return [_text(value)] if value else []
    if isinstance(value, list | tuple):
        return [one for element in value[:MOST_VALUES] for one in _values(element)]
    return []


def _text(value: str) -> str:
    """As SQLite takes it: names and manifests may hold what is not Unicode."""
    return value[:LONGEST_VALUE].encode("utf-8", "replace").decode("utf-8")


def _accuracies(readouts: Sequence[Path]) -> list[str | float]:
    if not readouts:
        return []
    from labctl.runs.format.readout import accuracies_of  # h5py takes long to load

    return [score for path in readouts for score in accuracies_of(path)]
