"""What every command prints: one JSON object, or text and tables, on standard output; warnings on standard error."""

import os
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Annotated, Any, TextIO

import typer
from rich.console import Console
from rich.text import Text

from labctl.commands.beside import past_the_buffer
from labctl.commands.columns import in_columns
from labctl.printable import json_line, printable

PLAIN_WIDTH = 200
"""Columns of a table that nobody looks at through a terminal: wide enough never to wrap a line for grep."""

JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON object on standard output.")]

_console = Console(highlight=False, emoji=False, soft_wrap=True, width=None if sys.stdout.isatty() else PLAIN_WIDTH)
errors = Console(file=past_the_buffer("stderr"), highlight=False, emoji=False, soft_wrap=True)
"""Standard error, also that of `labctl.commands.progress`."""


def show(result: Mapping[str, Any], as_json: bool, as_text: Callable[[], None]) -> None:
    """Print `result` as JSON, or let `as_text` print it for people.

    Raises:
        OSError: it cannot be printed, which is no failure of what was done.
    """
    try:
        if as_json:
            sys.stdout.write(json_line(result))
            sys.stdout.flush()
        else:
            as_text()
    except OSError as error:
        if error.filename is None:  # of no file that `as_text` reads
            error.filename = "standard output"
            error.add_note("the command itself is done: what it made is kept")
            _lead_nowhere(sys.stdout)
        raise


def say(line: str) -> None:
    """Print one line for people."""
    _console.print(printable(line), markup=False)


def tell(line: str) -> None:
    """Print one line for people on standard error, above a progress bar if there is one.

    Where it takes nothing, as on a full disk, what goes on is worth more than the line.
    """
    try:
        errors.print(printable(line), markup=False)
    except OSError:
        _lead_nowhere(sys.stderr)


def warn(line: str) -> None:
    """`tell` what somebody should heed."""
    tell(f"labctl: {line}")


def _lead_nowhere(stream: TextIO) -> None:
    """Drop what a stream that takes nothing still holds: it would fail again as Python ends (exit status 120)."""
    with suppress(OSError), open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), stream.fileno())


def table(headings: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Print a table for people."""
    lines = in_columns([[printable(str(cell)) for cell in row] for row in (headings, *rows)], _console)
    _console.print(Text(next(lines), style="bold"))
    _console.file.writelines(f"{line}\n" for line in lines)
