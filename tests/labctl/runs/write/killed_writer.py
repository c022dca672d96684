"""Write a run again and again; each time the process kills itself one step later on its way to the disk.

A step is a write (only half of the bytes arrive), an fsync or a rename (before it and after it). Usage:
`killed_writer.py FOLDER SHOTS`. Run n is FOLDER/n; one line of JSON a run on standard output: what the process had
appended, and what it had been told is on disk.
"""

import json
import os
import signal
import sys
from collections.abc import Callable
from io import FileIO
from pathlib import Path
from typing import Any

from labctl.runs.format import durable, journal
from tests.labctl.runs.conftest import SMALL, begin, measure

told, say = os.pipe()


def killing(fatal_step: int) -> Callable[[Callable[[], object]], None]:
    """A function to be called at each step; at the fatal one it does what it is given, and dies."""
    steps = iter(range(fatal_step + 1))

    def step(last_deed: Callable[[], object]) -> None:
        if next(steps) == fatal_step:
            last_deed()
            os.kill(os.getpid(), signal.SIGKILL)

    return step


def write_and_die(directory: Path, shots: int, fatal_step: int) -> None:
    step = killing(fatal_step)
    fsync, replace = os.fsync, os.replace

    class DyingFile(FileIO):
        def write(self, data: Any) -> int:
            step(lambda: super(DyingFile, self).write(data[: len(data) // 2]))
            return super().write(data)

    def dying_fsync(descriptor: int) -> None:
        step(lambda: None)
        fsync(descriptor)

    def dying_replace(source: Path, target: Path) -> None:
        step(lambda: None)
        replace(source, target)
        step(lambda: None)

    durable.FileIO = journal.FileIO = DyingFile  # type: ignore[attr-defined]
    os.fsync, os.replace = dying_fsync, dying_replace  # type: ignore[assignment]
    with begin(directory, shots=shots) as writer:
        for pass_index in range(len(SMALL.passes)):
            writer.scales(pass_index, 1e-3 * (pass_index + 1), 0.05)
            for shot in range(SMALL.shots):
                writer.append(pass_index, shot, measure(SMALL, pass_index, shot), pass_index + 1)
                os.write(say, (json.dumps([pass_index, shot + 1, writer.done]) + "\n").encode())
    os.write(say, b'"finished"\n')


def main(folder: Path, shots: int) -> None:
    for fatal_step in range(10_000):
        if not (child := os.fork()):
            write_and_die(folder / str(fatal_step), shots, fatal_step)
            os._exit(0)
        _, status = os.waitpid(child, 0)
        os.write(say, b'"end"\n')
        lines = []
        with os.fdopen(os.dup(told)) as heard:
            while (line := json.loads(heard.readline())) != "end":
                lines.append(line)
        if os.WIFEXITED(status):
            assert os.WEXITSTATUS(status) == 0, "the writer failed"
            assert lines[-1] == "finished"
            return
        assert os.WTERMSIG(status) == signal.SIGKILL
        print(json.dumps([line for line in lines if line != "finished"][-1:]))  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]))
