"""The command `labctl`: how it starts, and how every one of its commands ends."""

import atexit
import gc
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from io import TextIOWrapper
from tempfile import NamedTemporaryFile
from traceback import format_exception
from types import TracebackType
from typing import Annotated

import typer
from typer.exceptions import Abort, TyperException

from instruments.remedies import refusal
from labctl.commands.command_group import PLAIN, Stopped, UnloadedCommands
from labctl.commands.exit_status import FELL_SHORT, INTERRUPTED, WRONG_USE
from labctl.commands.refusal import refuse_bench_in_use
from labctl.errors import LabctlError, clock_ended, notes, one_line
from labctl.printable import json_line, log_printably, printable, printable_traceback

LESS = "end other programs, or ask for less, such as fewer images or a shorter window"

app = typer.Typer(
    name="labctl",
    cls=UnloadedCommands,
    help="Runs a photonic machine-vision bench, real or simulated. Without --station the simulated bench is used.",
    epilog="Errors are one line; --debug, anywhere on the line, adds the traceback.",
    no_args_is_help=True,
    **PLAIN,
)


def _tell_version(asked: bool) -> None:
    if asked:
        from labctl.runs.format.provenance import this_version

        sys.stdout.write(f"labctl {this_version()}\n")
        raise typer.Exit


@app.callback()
def labctl(
    version: Annotated[
        bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """What comes before a command."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run one command and end the process with its exit status."""
    atexit.register(gc.freeze)  # the end of Python would look through all that libraries have loaded
    _prepare_streams()
    words = list(sys.argv[1:] if arguments is None else arguments)
    debug = "--debug" in words
    log_printably()
    try:
        status = _status([word for word in words if word != "--debug"], debug=debug)
    finally:
        sys.excepthook = _show_uncaught  # typer has set its own
    sys.exit(status)


def _prepare_streams() -> None:
    """What is printed where somebody has closed the output goes to nowhere, and what its encoding lacks is escaped."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # has this number then, which a file of a run or a lock would have had
    for name in ("stdout", "stderr"):
        if isinstance(stream := getattr(sys, name), TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
        elif stream is None:
            setattr(sys, name, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115  # as long as the process


def _show_uncaught(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    sys.stderr.write(printable_traceback(kind, error, trace))


def _status(words: list[str], *, debug: bool) -> int:
    try:
        refuse_bench_in_use(words)
        status = app(words, prog_name="labctl", standalone_mode=False)
    except (Stopped, KeyboardInterrupt, Abort) as stopped:
        if "--json" in words:
            _show_error("interrupted", INTERRUPTED, stopped.args)
        return INTERRUPTED
    except TyperException as error:
        if type(error).__name__ == "NoArgsIsHelpError":  # which typer does not export
            sys.stderr.write(f"{error.format_message()}\n")
            return WRONG_USE
        return _complain(_misused(error, words), WRONG_USE, words)
    except Exception as error:  # noqa: BLE001  # of whatever kind, it ends in one line
        if debug:
            _show_uncaught(type(error), error, error.__traceback__)
        if isinstance(error, LabctlError):
            return _complain(one_line(error), error.exit_status, words, notes(error))
        known = refusal(error) if isinstance(error, OSError) else None
        if isinstance(error, MemoryError):
            known = f"{one_line(error) or 'no memory is left'}: {LESS}"
        elif clock_ended(error):
            known = one_line(error)
        return _complain(known or _unexpected(error), FELL_SHORT, words, notes(error))
    return status if isinstance(status, int) else 0


def _misused(error: TyperException, words: list[str]) -> str:
    what = " ".join(error.format_message().split()).removesuffix(".")
    if what.startswith("Got unexpected extra argument") and "--set" in words:
        return f"{what}: write --set before each setting"
    context = getattr(error, "ctx", None)
    command = "labctl" if context is None else context.command_path
    return f"{what}: `{command} --help` lists what there is"


def _unexpected(error: Exception) -> str:
    """One line for a failure that labctl has no words for; its traceback goes into a file.

    One that came through a protocol of the operator's own is his to mend.
    """
    from protocols.own_file import place_in

    what = f"{type(error).__name__}: {one_line(error)}"
    if (place := place_in(error)) is not None:
        return f"{place}: {what}: correct the protocol; --debug shows how it came there"
    what = f"{what}: labctl did not expect this"
    try:
        with NamedTemporaryFile("w", prefix="labctl-", suffix=".txt", delete=False, encoding="utf-8") as file:
            file.writelines(format_exception(error))
    except OSError:
        return f"{what}: repeat the command with --debug and report what it prints"
    return f"{what}: report it, with {file.name}"


def _complain(message: str, status: int, words: list[str], further: Sequence[str] = ()) -> int:
    for line in (message, *further):
        sys.stderr.write(f"labctl: {printable(line)}\n")
    if "--json" in words:
        _show_error(message, status, further)
    return status


def _show_error(message: str, status: int, further: Sequence[str]) -> None:
    with suppress(OSError):  # which may be what is wrong
        sys.stdout.write(json_line({"error": message, "exit": status} | ({"notes": list(further)} if further else {})))
