"""What a run directory holds: names, versions, the manifest, and the error of everything in `labctl.runs`.

```
runs/20261121T091500Z-image-readout-1a2b3c4d/
  manifest.json     what was asked and with what; written once, before the first shot
  plan.h5           the columns of every planned shot and the drive that is played; written once, before the manifest
  journal.jsonl     one checksummed line per closed shard, only ever appended to; the state of the run follows from it
  shards/000000.h5  a contiguous range of shots of one pass; never rewritten
  data.h5           all complete shots as one file, written at the end; what people open
  events.jsonl      what the run was doing, for whoever watches it: `labctl.runs.live.events`
  commands.log  figures/  report.html
```
"""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from typing import Any

from labctl.errors import RunError
from labctl.runs.format.shots import RunShape

FORMAT_VERSION = "1.1"
READABLE_MAJOR = 1
LONGEST_VERSION = 40  # characters of one that cannot be read, in a message
LARGEST_MANIFEST = 1 << 26  # characters; what is longer is cut, and then damaged
LIBVER = ("v108", "v108")  # the same bytes whatever HDF5 release writes them, readable by any HDF5 since 1.8
HDF5_ERRORS = (OSError, RuntimeError, KeyError, ValueError, TypeError)  # what h5py raises on a file that is not whole


@contextmanager
def noted_on(error: BaseException | None) -> Iterator[None]:
    """A `RunError` inside the block becomes a note to `error`, which came first; without one it is raised."""
    try:
        yield
    except RunError as failure:
        if error is None:
            raise
        if failure is not error:
            error.add_note(str(failure))


@dataclass(frozen=True)
class RunPaths:
    """Where things lie in a run directory."""

    directory: Path

    @property
    def manifest(self) -> Path:
        """What was asked and with what."""
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
        return self.directory / "figures"

    @property
    def report(self) -> Path:
        """The report a browser shows."""
        return self.directory / "report.html"

    def shard(self, number: int) -> Path:
        """File of shard `number`."""
        return self.shards / f"{number:06d}.h5"


@dataclass(frozen=True)
class Manifest:
    """The manifest of a run: `values` is what manifest.json holds."""

    values: Mapping[str, Any]

    @cached_property
    def shape(self) -> RunShape:
        """Size of the run."""
        return RunShape.from_json(self.values["shape"])

    @classmethod
    def read(cls, paths: RunPaths) -> "Manifest":
        """Read manifest.json.

        Raises:
            RunError: no run directory, a damaged manifest, or one of a later major version.
        """
        try:
            with paths.manifest.open(encoding="utf-8") as file:
                text = file.read(LARGEST_MANIFEST)
        except FileNotFoundError:
            raise RunError(f"{paths.directory}: not a run directory (no manifest.json in it)") from None
        except (OSError, UnicodeDecodeError) as error:
            raise RunError(f"{paths.manifest}: cannot be read: {error}") from error
        return cls.parse(text, paths.manifest)

    @classmethod
    def parse(cls, text: str, origin: Path) -> "Manifest":
        """Check and take the text of a manifest found at `origin`.

        Raises:
            RunError: damaged, or of a later major version.
        """
        try:
            values = json.loads(text)
            check_version(values["format_version"], origin)
            manifest = cls(values)
            _ = manifest.shape
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise RunError(f"{origin}: damaged manifest ({error!r}); restore it from a copy of the run") from error
        return manifest


def check_version(version: str, origin: Path) -> None:
    """Accept any 1.x.

    Raises:
        RunError: another major version, or no version at all.
    """
    found = re.fullmatch(r"(\d{1,9})\.(\d{1,9})", str(version))
    if not found or int(found[1]) != READABLE_MAJOR:
        told = repr(str(version)[:LONGEST_VERSION])
        raise RunError(f"{origin}: format {told}; this labctl reads {READABLE_MAJOR}.x: install a matching labctl")


def run_name(started: datetime, protocol: str, identity: str) -> str:
    """Name of a run directory, for example `20261121T091500Z-image-readout-1a2b3c4d`.

    `started` carries a time zone; `identity` is any text that tells this run's request from others (protocol, station,
    seeds): only its hash appears. The name is safe on every file system (no colon).
    """
    slug = re.sub(r"[^a-z0-9]+", "-", protocol.lower()).strip("-") or "run"
    return f"{started.astimezone(UTC):%Y%m%dT%H%M%SZ}-{slug}-{hashlib.sha256(identity.encode()).hexdigest()[:8]}"
