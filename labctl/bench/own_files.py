"""The station and protocol files that runs were begun with here: any other that a run names may be a stranger's.

Kept in the user's state folder (on Linux below XDG_STATE_HOME): a digest of path and content, one a line.
"""

import hashlib
import os
from contextlib import suppress
from pathlib import Path

from platformdirs import user_state_path

from instruments.toml_files import LARGEST_FILE

FILE = "stations"
MOST = 1000
"""Digests that are read: the last ones."""
DIGEST = 65
"""Characters of a line."""


def remember(path: Path) -> None:
    """Somebody here has begun a run with this file. Where that cannot be kept, a resume asks for it or refuses it."""
    with suppress(OSError, RuntimeError):  # the latter of a user without home
        digest = _digest(path)
        if digest not in _kept():
            kept = _file()
            kept.parent.mkdir(parents=True, exist_ok=True)
            with kept.open("a", encoding="ascii") as file:
                file.write(f"{digest}\n")


def is_own(path: Path, content: bytes | None = None) -> bool:
    """Whether a run was begun here with this file, as it is now, or with `content` in it."""
    try:
        return _digest(path, content) in _kept()
    except (OSError, RuntimeError):
        return False


def _file() -> Path:
    return user_state_path("labctl") / FILE


def _kept() -> set[str]:
    kept = _file()
    if not kept.is_file():
        return set()
    with kept.open("rb") as file:
        file.seek(max(kept.stat().st_size - MOST * DIGEST, 0))
        return set(file.read(MOST * DIGEST).decode("ascii", "replace").split())


def _digest(path: Path, content: bytes | None = None) -> str:
    if content is None:
        if not path.is_file():  # a FIFO has no end
            raise FileNotFoundError(path)
        with path.open("rb") as file:
            content = file.read(LARGEST_FILE)
    return hashlib.sha256(os.fsencode(path.resolve()) + b"\0" + content).hexdigest()
