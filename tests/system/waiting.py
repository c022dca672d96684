"""Waiting for what another process has done."""

import contextlib
import subprocess
from pathlib import Path
from typing import Any

from labctl.runs.format.layout import RunPaths


def until_stored(process: subprocess.Popen[Any], directory: Path, shards: int = 1) -> None:
    """Return as soon as there is a run whose journal names so many shards, or `process`, which writes it, has ended."""
    paths = RunPaths(directory)
    while process.poll() is None and not (
        paths.manifest.exists() and paths.journal.exists() and paths.journal.read_bytes().count(b"\n") >= shards
    ):
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(1e-3)  # the processor is for the run
