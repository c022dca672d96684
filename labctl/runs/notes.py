"""notes.jsonl: what people say of a run, while it goes on or later; beside what was measured, and never in it.

A line is a JSON object with its own checksum, such as

    {"time": "2026-11-23T14:02:47+00:00", "by": "ada", "note": "fibre touched", "tags": ["good"], "crc": "0a1b2c3d"}

`time` and `by` (who wrote it) are always there; `note`, `tags`, `untagged`, `star` and `operator` where they were said;
`picture` and its `sha256` where there is one in the folder `pictures`.
What was said is never changed: the last line about a tag, the star or the operator counts.
"""

import os
import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from hashlib import sha256
from io import BytesIO, FileIO
from typing import Any

from instruments.remedies import unreadable
from labctl.errors import RunError
from labctl.printable import printable
from labctl.runs.format.checked_line import decode, encode
from labctl.runs.format.durable import make_folder, not_made, replace_file, write_all
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.own_files import opened, read_own
from labctl.user import user

LARGEST = 1 << 24
LONGEST_NOTE, LONGEST_WORD = 4000, 100
_PICTURE = re.compile(r"\d{8}T\d{6}Z-[0-9a-f]{8}\.png")


@dataclass(frozen=True)
class Note:
    """One thing that was said: when (UTC, ISO 8601), by whom, and what; `picture` is a file of the run's, or empty."""

    time: str
    by: str
    text: str
    picture: str = ""


@dataclass(frozen=True)
class Notes:
    """What people say of a run.

    Attributes:
        notes: in the order in which they were written.
        tags: by name, as they may be shown; the operator, too.
        star: somebody marked the run.
        operator: who measured it, empty if nobody said.
        problems: a line of text for every damaged line.
    """

    notes: tuple[Note, ...] = ()
    tags: tuple[str, ...] = ()
    star: bool = False
    operator: str = ""
    problems: tuple[str, ...] = ()


def read_notes(paths: RunPaths) -> Notes:
    """What people say of a run; nothing where there is no file.

    Raises:
        RunError: the file cannot be read.
    """
    try:
        data = read_own(paths.notes, LARGEST)
    except FileNotFoundError:
        return Notes()
    except OSError as error:
        raise RunError(unreadable(paths.notes, error, "restore it from a copy, or remove it")) from error
    notes: list[Note] = []
    tags: set[str] = set()
    star, operator = False, ""
    problems: list[str] = []
    for number, line in enumerate(BytesIO(data), start=1):
        try:
            said = decode(line)
        except ValueError as error:
            problems.append(f"{paths.notes.name} line {number}: {error}")
            continue
        text, picture = str(said.get("note", "")), str(said.get("picture", ""))
        if text or picture:
            shown = picture if _PICTURE.fullmatch(picture) else ""
            notes.append(Note(str(said.get("time", "")), str(said.get("by", "")), text, shown))
        tags |= _words(said.get("tags"))
        tags -= _words(said.get("untagged"))
        star = bool(said.get("star", star))
        operator = printable(str(said.get("operator", operator)))
    return Notes(tuple(notes), tuple(sorted(tags)), star, operator, tuple(problems))


def require_run(paths: RunPaths) -> None:
    """Require a run of which something is or can be said.

    Raises:
        RunError: no such run.
    """
    if not paths.manifest.exists():
        raise RunError(f"{paths.directory}: not a run directory (no manifest.json in it): name a run")


def say_of(
    paths: RunPaths,
    text: str = "",
    *,
    tags: Sequence[str] = (),
    untagged: Sequence[str] = (),
    star: bool | None = None,
    operator: str | None = None,
    picture: bytes | None = None,
) -> None:
    """Append what is said of a run, in one line; nothing that is there is touched. `picture` is a PNG.

    Raises:
        RunError: no such run, it cannot be written, nothing was said, or it is too long.
    """
    require_run(paths)
    said = in_a_line(text, tags=tags, untagged=untagged, star=star, operator=operator)
    if not said and picture is None:
        raise RunError(f"{paths.directory}: nothing is said of it: write a note, a tag, a star or an operator")
    if picture is not None:
        said |= _kept(paths, picture)
    line = encode({"time": datetime.now(UTC).isoformat(timespec="seconds"), "by": user()} | said)
    try:
        with FileIO(paths.notes, "a+", opener=opened) as file:
            length = file.seek(0, os.SEEK_END)
            torn = length > 0 and (file.seek(length - 1), file.read(1))[1] != b"\n"
            write_all(file, b"\n" * torn + line)
            os.fsync(file.fileno())
    except OSError as error:
        raise not_made(paths.notes, error) from error


def in_a_line(
    text: str = "",
    *,
    tags: Sequence[str] = (),
    untagged: Sequence[str] = (),
    star: bool | None = None,
    operator: str | None = None,
) -> dict[str, Any]:
    """What is said of a run, as a line of the file has it; empty where nothing is.

    Raises:
        RunError: it is too long, or a tag or name is empty.
    """
    if len(text) > LONGEST_NOTE:
        raise RunError(f"a note of {len(text)} characters: write {LONGEST_NOTE} at most")
    said: dict[str, Any] = {
        "note": printable(text.strip()),
        "tags": [_word(tag) for tag in tags],
        "untagged": [_word(tag) for tag in untagged],
        "star": star,
        "operator": None if operator is None else _word(operator),
    }
    return {name: value for name, value in said.items() if value not in ("", [], None)}


def _kept(paths: RunPaths, picture: bytes) -> dict[str, str]:
    """Put a picture beside the notes; what a line says of it."""
    digest = sha256(picture).hexdigest()
    path = paths.pictures / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{digest[:8]}.png"
    try:
        make_folder(paths.pictures)
    except OSError as error:
        raise not_made(path, error) from error
    replace_file(path, picture, not_made)
    return {"picture": path.name, "sha256": digest}


def _word(text: str) -> str:
    word = printable(" ".join(text.split()))
    if not word or len(word) > LONGEST_WORD:
        raise RunError(f"{word[:LONGEST_WORD]!r}: is no tag or name: write 1 to {LONGEST_WORD} characters")
    return word


def _words(found: object) -> set[str]:
    return {printable(str(word)) for word in found} if isinstance(found, list) else set()
