"""What is asked of a run from outside, and of the sweep that it is part of; or of a sweep, and of its run under way."""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from labctl.runs.format.layout import RunPaths
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.owner import writer_of
from labctl.runs.sweep import is_sweep, places, read


def tell(directory: Path, word: Word) -> None:
    """Ask the run or sweep in `directory` for something: `labctl.runs.live.control_file.ask`.

    A sweep looks before each of its runs and when one has begun. It is asked first, so that no run begins unheard.

    Raises:
        OSError: it cannot be written.
        RunError: the file of the sweep is damaged.
    """
    if is_sweep(directory):
        ask(directory, word)
        if (run := _under_way(directory)) is not None:
            ask(run, word)
        return
    if is_sweep(directory.parent) and writer_of(RunPaths(directory.parent)) is not None:
        ask(directory.parent, word)
    ask(directory, word)


def stop_at_once(directory: Path, process: int | None) -> None:
    """Ask the run or sweep in `directory` to end now, in the safe state, by a signal to `process` too.

    `process` is None where it is not known for certain which process writes the run, and on Windows, which would kill
    it: then the run notices at its next record.

    Raises:
        OSError: the word cannot be written, and there is no process to signal.
        RunError: the file of the sweep is damaged.
    """
    try:
        tell(directory, Word.STOP_NOW)
    except OSError:
        if process is None:
            raise
    if process is not None and sys.platform != "win32":
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGTERM)


def _under_way(sweep: Path) -> Path | None:
    """The run of a sweep that a process of this machine writes now: if any, the one that reported last."""
    told = {}
    for name, _ in places(read(sweep).sweep):
        with suppress(OSError):
            told[sweep / name] = RunPaths(sweep / name).events.stat().st_mtime_ns
    latest = max(told, key=lambda run: told[run], default=None)
    return latest if latest is not None and writer_of(RunPaths(latest)) is not None else None
