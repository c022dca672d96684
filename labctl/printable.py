"""Text as it may be shown: what a terminal, or a reader's eye, would obey instead of showing is written out.

Escape sequences move the cursor and rename the window, marks of direction turn a line round, and half a character ends
a program that prints it. They come from files, names of folders, instruments' replies and names in stations. Whatever
is printed for people goes through `printable`, and whatever is printed for programs through `json_line`.
"""

import json
import logging
import shlex
import sys
from pathlib import Path
from traceback import format_exception
from types import TracebackType
from typing import Any


def printable(text: str) -> str:
    r"""`text` with all but letters, digits, signs and plain blanks written as Python writes them, such as `\x1b`."""
    if text.isprintable():
        return text
    return "".join(one if one.isprintable() else one.encode("unicode_escape").decode() for one in text)


def printable_lines(text: str) -> str:
    """`text` as `printable` gives it, line by line."""
    return "\n".join(printable(line) for line in text.splitlines())


def json_line(result: Any) -> str:
    """One JSON object in one line of printable ASCII; it ends with the line's end."""
    return json.dumps(result, allow_nan=False).replace("\x7f", "\\u007f") + "\n"


def typed(*words: str) -> str:
    """Words of a command as they are typed: the shells of Windows have other quotes, and its paths need none."""
    if sys.platform == "win32":
        from subprocess import list2cmdline

        return list2cmdline(words)
    return shlex.join(words)


def typed_path(path: Path) -> str:
    """A path as it is typed: one that begins with a dash would be an option."""
    return typed(f"./{path}" if str(path).startswith("-") else str(path))


def printable_traceback(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> str:
    """What Python prints of an error that nobody caught."""
    return printable_lines("".join(format_exception(kind, error, trace))) + "\n"


def log_printably() -> None:
    """Whatever is logged in this process, and goes to standard error since nobody else takes it, is printable."""
    if logging.lastResort is not None:
        logging.lastResort.setFormatter(PrintableFormatter())


class PrintableFormatter(logging.Formatter):
    """The message of a record, and what it says of an exception."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 - logging's name
        """The message, in one line."""
        return printable(super().formatMessage(record))

    def formatException(self, ei: Any) -> str:  # noqa: N802 - logging's name
        """The traceback."""
        return printable_lines(super().formatException(ei))
