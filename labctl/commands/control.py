"""`labctl pause`, `go-on`, `stop`, `dark`: what a run or sweep that another process carries out is told."""

from pathlib import Path
from typing import Annotated

import typer

from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show
from labctl.errors import UsageError
from labctl.runs.asking import stop_at_once, tell
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.own_files import require_own_files
from labctl.runs.format.store import here
from labctl.runs.live.alarm import may_emit, say_dark
from labctl.runs.live.control_file import Word
from labctl.runs.live.owner import writer_of

Run = Annotated[Path, typer.Argument(help="Directory of a running run, or of a sweep.", parser=here)]


def pause(run: Run, as_json: JsonOption = False) -> int:
    """Make a running run go dark after this record and wait."""
    return _ask(run, Word.PAUSE, "goes dark after this record and waits for labctl go-on", as_json)


def go_on(run: Run, as_json: JsonOption = False) -> int:
    """End a pause."""
    return _ask(run, Word.GO_ON, "goes on", as_json)


def stop(
    run: Run,
    now: Annotated[bool, typer.Option("--now", help="Do not wait for the end of the record.")] = False,
    as_json: JsonOption = False,
) -> int:
    """End a running run in the safe state, and the sweep that it is part of; labctl resume goes on."""
    return _ask(run, Word.STOP_NOW if now else Word.STOP, "ends in the safe state", as_json)


def dark(
    run: Annotated[Path, typer.Argument(help="Directory of a run.", parser=here)], as_json: JsonOption = False
) -> int:
    """Confirm that you have seen the laser dark, after a run that could not switch it off."""
    require_own_files(run)
    if not run.is_dir():
        raise UsageError(f"{run}: no such directory: name the run whose laser you have seen dark")
    if not may_emit(run):
        raise UsageError(f"{run}: its laser is not reported as emitting: there is nothing to confirm")
    try:
        say_dark(run)
    except OSError as error:
        raise UsageError(
            f"{run}: cannot be written ({error.strerror}): repeat this as the user who started the run"
        ) from None
    show({"run": str(run), "seen": "dark"}, as_json, lambda: say(f"{run}: the laser is recorded as dark"))
    return DONE


def _ask(run: Path, word: Word, what: str, as_json: bool) -> int:
    require_own_files(run)
    writer = writer_of(RunPaths(run))
    if writer is None:
        raise UsageError(f"{run}: no process of this machine is writing this run: nothing to {word}")
    try:
        if word is Word.STOP_NOW:
            stop_at_once(run, writer.process if writer.heeds_signals else None)
        else:
            tell(run, word)
    except OSError as error:
        raise UsageError(
            f"{run}: cannot be asked ({error.strerror}): repeat this as the user who started the run"
        ) from None
    show({"run": str(run), "asked": str(word), "process": writer.process}, as_json, lambda: say(f"{run}: {what}"))
    return DONE
