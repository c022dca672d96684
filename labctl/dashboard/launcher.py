"""Starting what the page asks for: a command of labctl in a process of its own, which outlives the dashboard."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import entry_points
from pathlib import Path
from secrets import token_hex
from threading import Thread
from typing import IO

from labctl.apart import apart
from labctl.printable import printable, typed
from labctl.runs.format.layout import run_name

COMMAND = (sys.executable, "-P", "-c", "from labctl.commands.main import main; main()")
"""`-P`: nothing is imported from the folder that the dashboard is started in."""
USUAL = "image-readout"
LONGEST_PRINTED = 2000


@dataclass(frozen=True)
class Asked:
    """A run as the form asks for it, or a sweep where it names axes; an empty station is the simulated bench."""

    protocol: str
    settings: Mapping[str, str] = field(default_factory=dict)
    over: tuple[str, ...] = ()
    station: str = ""
    armed: bool = False
    attended: bool = False

    @property
    def words(self) -> list[str]:
        """What is typed after `labctl` for it.

        Raises:
            ValueError: there is no such protocol.
        """
        if self.protocol not in protocols():
            raise ValueError(f"{self.protocol!r}: no such protocol")
        return [
            "sweep" if self.over else "run",
            self.protocol,
            *(f"--set={name}={value}" for name, value in self.settings.items()),
            *(f"--over={axis}" for axis in self.over),
            *([f"--station={self.station}"] if self.station else []),
            *allowed(armed=self.armed, attended=self.attended),
        ]


@dataclass
class Started:
    """A command that was started here, and what it prints."""

    process: subprocess.Popen[bytes]
    printed: IO[bytes]

    def failure(self) -> str:
        """What the command printed if it has ended in anything but success; empty otherwise."""
        if self.process.poll() in (None, 0):
            return ""
        self.printed.seek(0)
        lines = self.printed.read(LONGEST_PRINTED).decode(errors="replace").strip()
        return lines or f"it ended with status {self.process.returncode}"


def to_resume(directory: Path, station: str, *, armed: bool, attended: bool) -> list[str]:
    """What is typed after `labctl` to go on with the run or sweep in `directory`; an empty station is its own one."""
    named = [f"--station={station}"] if station else []
    return ["resume", *named, *allowed(armed=armed, attended=attended), "--", str(directory)]


def allowed(*, armed: bool, attended: bool) -> list[str]:
    """The options by which somebody allows light."""
    return [word for word, said in (("--arm", armed), ("--attended", attended)) if said]


def protocols() -> list[str]:
    """Names of the protocols that are installed."""
    return sorted({entry.name for entry in entry_points(group="labctl.protocols")})


def in_words(words: Sequence[str]) -> str:
    """A command as it would be typed, as it may be shown."""
    return f"labctl {printable(typed(*words))}"


def new_directory(folder: Path, asked: Asked) -> Path:
    """Where a run or sweep goes."""
    name = run_name(datetime.now(UTC), asked.protocol, token_hex(8))
    return folder / (f"{name}-sweep" if asked.over else name)


def start(words: Sequence[str], environment: Mapping[str, str]) -> Started:
    """Start a command, with `environment` in addition to that of this process.

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
        **apart(),
    )
    Thread(target=process.wait, daemon=True).start()  # or its entry stays when it has ended and no page asks for it
    return Started(process, printed)
