"""What is asked of a run from outside, or of a sweep, which is asked of all its runs under way."""

import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

from labctl.runs.format.layout import RunPaths
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.owner import writer_of
from labctl.runs.sweep import is_sweep


def tell(directory: Path, word: Word) -> None:
    """Ask the run or sweep in `directory` for something: `labctl.runs.live.control_file.ask`.

    What a run is asked, the sweep under way that it is part of is asked. A sweep looks before each of its runs and when
    one has begun. It is asked first, so that no run begins unheard.

    Raises:
        OSError: it cannot be written.
    """
    part = is_sweep(directory.parent) and writer_of(RunPaths(directory.parent)) is not None
    asked = directory.parent if part else directory
    ask(asked, word)
    if is_sweep(asked):
        for run in asked.iterdir():
            if writer_of(RunPaths(run)) is not None:
                ask(run, word)


def stop_at_once(directory: Path, process: int | None) -> None:
    """Ask the run or sweep in `directory` to end now, in the safe state, by a signal to `process` too.

    `process` is None where it is not known for certain which process writes the run. Then, and on Windows, where a
    signal would kill it, the run notices at its next record.

    Raises:
        OSError: the word cannot be written, and there is no process to signal.
    """
    if sys.platform == "win32":
        process = None
    try:
        tell(directory, Word.STOP_NOW)
    except OSError:
        if process is None:
            raise
    if process is not None:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGTERM)
