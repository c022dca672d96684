"""Where things lie in a run directory, and what it is called.

```
runs/20261121T091500Z-image-readout-1a2b3c4d/
  manifest.json     what was requested and with what; written once, before the first shot
  plan.h5           the columns of every planned shot and the drive that is played; written once, before the manifest
  journal.jsonl     one checksummed line per closed shard, only ever appended to; the state of the run follows from it
  shards/000000.h5  a contiguous range of shots of one pass; never rewritten
  data.h5           all complete shots as one file, written at the end; what people open
  notes.jsonl       what people say of it, one checksummed line each, only ever appended to: `labctl.runs.notes`
  events.jsonl      what the run was doing, for whoever watches it: `labctl.runs.live.events`
  commands.log  figures/  report.html
```
"""

import hashlib
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from labctl.runs.format.store import is_elsewhere


def is_taken(path: Path) -> bool:
    """Whether a file is there, or a folder that holds something: what is written anew needs another place."""
    return path.exists() and (not path.is_dir() or any(path.iterdir()))


@dataclass(frozen=True)
class RunPaths:
    """Where things lie in a run directory."""

    directory: Path

    @property
    def _made(self) -> Path:
        """Where figures and report go: of a run that is elsewhere to a folder of its name here."""
        return Path(self.directory.name) if is_elsewhere(self.directory) else self.directory

    @property
    def manifest(self) -> Path:
        """What was requested and with what."""
        return self.directory / "manifest.json"

    @property
    def plan(self) -> Path:
        """Planned shots and drive."""
        return self.directory / "plan.h5"

    @property
    def journal(self) -> Path:
        """One line per closed shard."""
        return self.directory / "journal.jsonl"

    @property
    def shards(self) -> Path:
        """Folder of the shards."""
        return self.directory / "shards"

    @property
    def data(self) -> Path:
        """All complete shots in one file."""
        return self.directory / "data.h5"

    @property
    def commands(self) -> Path:
        """Every message to every instrument."""
        return self.directory / "commands.log"

    @property
    def events(self) -> Path:
        """What the run was doing."""
        return self.directory / "events.jsonl"

    @property
    def notes(self) -> Path:
        """What people say of the run."""
        return self.directory / "notes.jsonl"

    @property
    def pictures(self) -> Path:
        """Folder of the pictures that notes have."""
        return self.directory / "pictures"

    @property
    def models(self) -> Path:
        """Folder of the readouts trained on the run."""
        return self.directory / "models"

    @property
    def readouts(self) -> list[Path]:
        """The readouts in that folder, by name."""
        return sorted(self.models.glob("*.h5"))

    @property
    def figures(self) -> Path:
        """Folder of the figures."""
        return self._made / "figures"

    @property
    def report(self) -> Path:
        """The report a browser shows."""
        return self._made / "report.html"

    def shard(self, number: int) -> Path:
        """File of shard `number`."""
        return self.shards / f"{number:06d}.h5"


def run_name(started: datetime, protocol: str, identity: str) -> str:
    """Name of a run directory, for example `20261121T091500Z-image-readout-1a2b3c4d`.

    `started` carries a time zone; `identity` is any text that distinguishes this run's request from others (protocol,
    station, seeds): only its hash appears. The name is safe on every file system (no colon).
    """
    slug = re.sub(r"[^a-z0-9]+", "-", protocol.lower()).strip("-") or "run"
    return f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}-{slug}-{hashlib.sha256(identity.encode()).hexdigest()[:8]}"
