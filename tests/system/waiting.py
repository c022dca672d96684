"""Waiting for what another process has done."""

import contextlib
import subprocess
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

from labctl.runs.format.layout import RunPaths

Found = TypeVar("Found")


def until(happened: Callable[[], Found | None]) -> Found:
    """What `happened` says, as soon as that is something; a wait in vain ends with the time that a test may take."""
    pause = threading.Event()
    while not (found := happened()):
        pause.wait(1e-2)  # the processor is for the other process
    return found


def until_stored(process: subprocess.Popen[Any], directory: Path, shards: int = 1) -> None:
    """Return as soon as there is a run whose journal names so many shards, or `process`, which writes it, has ended."""
    paths = RunPaths(directory)
    while process.poll() is None and not (
        paths.manifest.exists() and paths.journal.exists() and paths.journal.read_bytes().count(b"\n") >= shards
    ):
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(1e-3)  # the processor is for the run
