"""manifest.json: what was requested and with what, written before the first shot."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from instruments.remedies import unreadable
from labctl.errors import RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.own_files import read_own, require_own_files
from labctl.runs.format.shape import RunShape
from labctl.runs.format.version import check_version

LARGEST_MANIFEST = 1 << 23  # bytes: that of a scan of 5000 wavelengths has some 0.5 MB

SUSPECT = "suspect"
"""Why records are in doubt, and how many for each reason: a key of the manifest of a run that ended so."""
REPLAY = "replay"
"""`name` and `sha256` of each recording that answered in place of the instruments: a key of such a run's manifest."""
WRITTEN_AFTER_THE_PLAN = ("plan_sha256", SUSPECT)
"""Keys that the digest in plan.h5 cannot know."""


def manifest_digest(values: Mapping[str, Any]) -> str:
    """SHA-256 of what a manifest says, in whatever order: plan.h5 keeps it, so that an edited manifest is known."""
    kept = {key: value for key, value in values.items() if key not in WRITTEN_AFTER_THE_PLAN}
    return hashlib.sha256(json.dumps(kept, sort_keys=True).encode()).hexdigest()


def protocol_settings(values: Mapping[str, Any]) -> Mapping[str, Any]:
    """The settings of the protocol that a manifest names; none where it says none."""
    protocol = values.get("protocol")
    settings = protocol.get("settings") if isinstance(protocol, dict) else None
    return settings if isinstance(settings, dict) else {}


def inputs_source(values: Mapping[str, Any]) -> str | None:
    """What the inputs of a run are known by, together with their places; None where nobody says.

    Runs of earlier versions say how their set was called.
    """
    found = values.get("inputs_source", protocol_settings(values).get("dataset"))
    return found if isinstance(found, str) and found else None


@dataclass(frozen=True)
class Manifest:
    """The manifest of a run: `values` is what manifest.json holds."""

    values: Mapping[str, Any]

    def with_suspect(self, reasons: Mapping[str, int]) -> "Manifest":
        """What it is of a run in which records are in doubt for `reasons`, or none are any more."""
        kept = {key: value for key, value in self.values.items() if key != SUSPECT}
        return Manifest(kept | ({SUSPECT: dict(reasons)} if reasons else {}))

    def encode(self) -> bytes:
        """The bytes of manifest.json."""
        return json.dumps(dict(self.values), indent=2, allow_nan=False).encode()

    @cached_property
    def shape(self) -> RunShape:
        """Size of the run."""
        return RunShape.from_json(self.values["shape"])

    @classmethod
    def read(cls, paths: RunPaths) -> "Manifest":
        """Read manifest.json, of a run whose directory holds nothing but files and folders.

        Raises:
            RunError: no run directory, or one that holds something else, a damaged manifest, or one of a later major
                version.
        """
        if paths.manifest.exists():  # what is in a folder that is no run is nobody's business here
            require_own_files(paths.directory)
        try:
            text = read_own(paths.manifest, LARGEST_MANIFEST).decode()
        except FileNotFoundError:
            raise RunError(f"{paths.directory}: not a run directory (no manifest.json in it)") from None
        except OSError as error:
            raise RunError(unreadable(paths.manifest, error, "restore it from a copy of the run")) from error
        except UnicodeDecodeError as error:
            raise RunError(f"{paths.manifest}: cannot be read ({error}): restore it from a copy of the run") from error
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
