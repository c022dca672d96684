"""What waits, runs, is done or failed: a SQLite file beside the runs, which any process may write at any time."""

import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from enum import StrEnum
from itertools import count
from pathlib import Path
from typing import Any

from labctl.errors import RunError, UsageError, writing

FILE = "queue.sqlite"
APPLICATION, VERSION = 0x6C616271, 2
WAIT_S = 10.0
"""For another process that writes at the same moment."""
_TABLES = f"""
CREATE TABLE item (
    number INTEGER PRIMARY KEY AUTOINCREMENT, place REAL, words TEXT, directory TEXT, plan TEXT, state TEXT,
    added_by TEXT, added TEXT, began TEXT, ended TEXT, message TEXT, cwd TEXT DEFAULT ''
);
CREATE TABLE wish (word TEXT);
PRAGMA application_id = {APPLICATION};
PRAGMA user_version = {VERSION};
"""
_COLUMNS = "number, words, directory, plan, cwd, state, added_by, added, began, ended, message"


class State(StrEnum):
    """Of an item."""

    WAITING = "waiting"
    RUNNING = "running"
    DONE = "done"
    FAILED = "failed"


UNDONE = (State.WAITING, State.RUNNING)


class Wish(StrEnum):
    """What whoever carries a queue out is asked for: to stop after this item, or now."""

    STOP = "stop"
    STOP_NOW = "stop now"


@dataclass(frozen=True)
class Item:
    """A run or sweep: the words of its command, where it goes, what was forecast, and what became of it.

    Times are ISO 8601 in UTC, empty for never. message: of a failure. cwd: the folder in which the command was typed,
    from which its paths count; empty where an earlier version has not noted it.
    """

    number: int
    words: tuple[str, ...]
    directory: Path
    plan: Mapping[str, Any] = field(default_factory=dict)
    cwd: str = ""
    state: State = State.WAITING
    added_by: str = ""
    added: str = ""
    began: str = ""
    ended: str = ""
    message: str = ""


class Queue:
    """The queue of a folder of runs."""

    def __init__(self, folder: Path) -> None:
        """Of `folder`; the file is made when something is added."""
        self.folder = folder
        self.path = folder / FILE

    def items(self) -> list[Item]:
        """All items in their order: what is done or running first, as it came, then what waits."""
        with self._open() as database:
            rows = database.execute(f"SELECT {_COLUMNS} FROM item ORDER BY place")  # noqa: S608 -- constants
            return [_item(row) for row in rows]

    def add(self, words: Sequence[str], directory: Path | None, plan: Mapping[str, Any], added_by: str) -> Item:
        """One more, behind all others; without a `directory` into a new one, of which its words say so.

        Its paths count from the folder that this process is in.

        Raises:
            UsageError: another item that waits or runs goes there.
        """
        directory = None if directory is None else Path(os.path.abspath(directory))
        with self._open(make=True) as database:
            undone = database.execute("SELECT number, directory FROM item WHERE state IN (?, ?)", UNDONE)
            for number, taken in undone:
                if Path(os.path.abspath(taken)) == directory:
                    raise UsageError(f"{directory}: is where item {number} of the queue goes: name another --out")
            (last,) = database.execute("SELECT coalesce(max(place), 0) FROM item").fetchone()
            if directory is None:
                directory = self._new_directory(database)
                words = [words[0], "--out", str(directory), *words[1:]]  # behind a -- it would be no option
            values = (json.dumps(list(words)), str(directory), json.dumps(dict(plan)), os.getcwd(), State.WAITING)
            number = database.execute(
                f"INSERT INTO item (place, {_COLUMNS}) VALUES (?, NULL, ?, ?, ?, ?, ?, ?, ?, '', '', '')",  # noqa: S608 -- constants
                (last + 1, *values, added_by, _now()),
            ).lastrowid
        return next(item for item in self.items() if item.number == number)

    def move(self, number: int, place: int) -> None:
        """Make an item the so-manieth of those that wait; 1 is the next.

        Raises:
            UsageError: there is no such item that waits, or no such place.
        """
        with self._open() as database:
            waiting = [one for (one,) in _waiting(database) if one != number]
            self._require_waiting(database, number)
            if not 1 <= place <= len(waiting) + 1:
                raise UsageError(f"place {place}: {len(waiting) + 1} wait: choose 1 to {len(waiting) + 1}")
            waiting.insert(place - 1, number)
            (behind,) = database.execute("SELECT coalesce(max(place), 0) FROM item").fetchone()
            for order, one in enumerate(waiting, start=1):
                database.execute("UPDATE item SET place = ? WHERE number = ?", (behind + order, one))

    def remove(self, number: int) -> None:
        """Take out an item; what it has measured stays.

        Raises:
            UsageError: there is no such item, or it is running.
        """
        with self._open() as database:
            found = database.execute("SELECT state FROM item WHERE number = ?", (number,)).fetchone()
            if found is None or found[0] == State.RUNNING:
                why = "there is none" if found is None else "it is running, 'labctl queue stop --now' ends it"
                raise UsageError(f"item {number}: {why}: see 'labctl queue list'")
            database.execute("DELETE FROM item WHERE number = ?", (number,))

    def claim(self) -> Item | None:
        """The next one, as it waited: it is running from now on. None where none waits."""
        with self._open() as database:
            waiting = f"SELECT {_COLUMNS} FROM item WHERE state = ? ORDER BY place"  # noqa: S608 -- constants
            row = database.execute(waiting, (State.WAITING,)).fetchone()
            if row is None:
                return None
            item = _item(row)
            database.execute(
                "UPDATE item SET state = ?, began = ?, ended = '', message = '' WHERE number = ?",
                (State.RUNNING, _now(), item.number),
            )
        return item

    def end(self, number: int, state: State, message: str = "") -> None:
        """An item that ran is done, failed, or waits again."""
        with self._open() as database:
            database.execute(
                "UPDATE item SET state = ?, ended = ?, message = ? WHERE number = ?", (state, _now(), message, number)
            )

    def put_back(self, items: Iterable[Item]) -> None:
        """What ran waits again, and nobody is asked for anything: whoever carried it out is gone."""
        with self._open() as database:
            numbers = [(State.WAITING, item.number) for item in items]
            database.executemany("UPDATE item SET state = ? WHERE number = ?", numbers)
            database.execute("DELETE FROM wish")

    def ask(self, wish: Wish) -> None:
        """Ask whoever carries the queue out for something."""
        with self._open() as database:
            database.execute("INSERT INTO wish VALUES (?)", (wish,))

    @property
    def wishes(self) -> set[Wish]:
        """What it is asked for."""
        with self._open() as database:
            return {Wish(word) for (word,) in database.execute("SELECT word FROM wish")}

    def _new_directory(self, database: sqlite3.Connection) -> Path:
        """A directory of the folder that is not there and that no item has."""
        named = {Path(one) for (one,) in database.execute("SELECT directory FROM item")}
        ways = (Path(os.path.abspath(self.folder / f"queue-{number:04d}")) for number in count(1))
        return next(way for way in ways if way not in named and not way.exists())

    def _require_waiting(self, database: sqlite3.Connection, number: int) -> None:
        if (number,) not in _waiting(database).fetchall():
            raise UsageError(f"item {number}: none of those that wait: see 'labctl queue list'")

    @contextmanager
    def _open(self, *, make: bool = False) -> Iterator[sqlite3.Connection]:
        """The tables in a transaction of their own; in memory as long as there is no file.

        Raises:
            RunError: the file is none of a queue, or cannot be written.
        """
        if make:
            with writing(self.folder, "name another --folder"):
                self.folder.mkdir(parents=True, exist_ok=True)
        where = self.path if make or self.path.exists() else ":memory:"
        try:
            with closing(sqlite3.connect(where, timeout=WAIT_S)) as database, database:
                database.execute("BEGIN IMMEDIATE")
                (application,) = database.execute("PRAGMA application_id").fetchone()
                if application != APPLICATION:
                    if database.execute("SELECT 1 FROM sqlite_master").fetchone():
                        raise sqlite3.DatabaseError("is of another program")
                    for statement in _TABLES.split(";"):
                        database.execute(statement)
                elif database.execute("PRAGMA user_version").fetchone() == (1,):
                    database.execute("ALTER TABLE item ADD COLUMN cwd TEXT DEFAULT ''")
                    database.execute(f"PRAGMA user_version = {VERSION}")
                yield database
        except sqlite3.Error as error:
            raise RunError(f"{self.path}: cannot be used as a queue ({error}): name another --folder") from None


def _waiting(database: sqlite3.Connection) -> sqlite3.Cursor:
    return database.execute("SELECT number FROM item WHERE state = ? ORDER BY place", (State.WAITING,))


def _item(row: Sequence[Any]) -> Item:
    number, words, directory, plan, cwd, state, *said = row
    try:
        return Item(number, tuple(json.loads(words)), Path(directory), json.loads(plan), cwd, State(state), *said)
    except (ValueError, TypeError) as error:
        raise sqlite3.DatabaseError(f"item {number} is damaged: {error}") from None


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")
