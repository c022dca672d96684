"""The format that the files of a run are written in, and the formats that are read."""

import re
from pathlib import Path

from labctl.errors import RunError

FORMAT_VERSION = "1.4"
READABLE_MAJOR = 1
LONGEST_VERSION = 40  # characters of one that cannot be read, in a message


def check_version(version: str, origin: Path) -> None:
    """Accept any 1.x.

    Raises:
        RunError: another major version, or no version at all.
    """
    found = re.fullmatch(r"(\d{1,9})\.(\d{1,9})", str(version))
    if not found or int(found[1]) != READABLE_MAJOR:
        shown = repr(str(version)[:LONGEST_VERSION])
        raise RunError(f"{origin}: format {shown}; this labctl reads {READABLE_MAJOR}.x: install a matching labctl")
