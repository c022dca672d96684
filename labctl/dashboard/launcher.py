"""Starting a run from the page: the command `labctl run` in a process of its own, which outlives the dashboard."""

import os
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.metadata import entry_points
from pathlib import Path
from secrets import token_hex
from typing import IO

from labctl.runs.format.layout import run_name

COMMAND = (sys.executable, "-P", "-c", "from labctl.commands.main import main; main()")
"""`-P`: nothing is imported from the folder that the dashboard is started in."""
USUAL = "image-readout"
LONGEST_PRINTED = 2000


@dataclass(frozen=True)
class Asked:
    """A run as the form asks for it; an empty station is the simulated bench. `settings` are key=value, one a line."""

    protocol: str
    settings: str = ""
    station: str = ""
    armed: bool = False
    attended: bool = False


@dataclass
class Started:
    """A run that was started here: its directory, and its process with what that prints."""

    directory: Path
    process: subprocess.Popen[bytes]
    printed: IO[bytes]

    def failure(self) -> str:
        """What the command printed if it has ended without making a run; empty otherwise."""
        if self.process.poll() in (None, 0) or (self.directory / "manifest.json").exists():
            return ""
        self.printed.seek(0)
        lines = self.printed.read(LONGEST_PRINTED).decode(errors="replace").strip()
        return lines or f"labctl run ended with status {self.process.returncode}"


def protocols() -> list[str]:
    """Names of the protocols that are installed."""
    return sorted({entry.name for entry in entry_points(group="labctl.protocols")})


def arguments(asked: Asked, directory: Path) -> list[str]:
    """What is typed after `labctl` for it."""
    settings = [line.strip() for line in asked.settings.splitlines() if line.strip()]
    station = [f"--station={asked.station}"] if asked.station else []
    allowed = [word for word, said in (("--arm", asked.armed), ("--attended", asked.attended)) if said]
    return ["run", asked.protocol, *(f"--set={one}" for one in settings), *station, *allowed, f"--out={directory}"]


def in_words(asked: Asked, directory: Path) -> str:
    """The command as it would be typed."""
    return f"labctl {shlex.join(arguments(asked, directory))}"


def new_directory(folder: Path, asked: Asked) -> Path:
    """Where the run goes."""
    return folder / run_name(datetime.now(UTC), asked.protocol, token_hex(8))


def start(asked: Asked, directory: Path, environment: Mapping[str, str]) -> Started:
    """Start the command, with `environment` in addition to that of this process.

    Raises:
        ValueError: there is no such protocol.
        OSError: the process cannot be started.
    """
    if asked.protocol not in protocols():
        raise ValueError(f"{asked.protocol!r}: no such protocol")
    return begun(arguments(asked, directory), directory, environment)


def begun(words: Sequence[str], directory: Path, environment: Mapping[str, str]) -> Started:
    """Start the command `labctl` with some words, which makes `directory`.

    Raises:
        OSError: the process cannot be started.
    """
    printed = tempfile.TemporaryFile()  # noqa: SIM115  # for the process; a pipe would break when the dashboard ends
    process = subprocess.Popen(  # noqa: S603
        [*COMMAND, *words],
        env=os.environ | environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=printed,
        start_new_session=True,
    )
    return Started(directory, process, printed)
