"""Where a run came from: the packages, the interpreter and the source revision that made it."""

import hashlib
import platform
import subprocess
from functools import cache
from importlib import metadata
from pathlib import Path

DISTRIBUTION = "photonic-labctl"
PACKAGES = (DISTRIBUTION, "numpy", "scipy", "scikit-learn", "h5py", "pydantic", "pyvisa", "pyvisa-py")
SOURCES = ("labctl", "protocols", "instruments", "sim_backends")
"""The distribution's own packages."""
_ROOT = Path(__file__).parents[3]

version = cache(metadata.version)
"""Of an installed distribution, as this process first found it."""


def versions() -> dict[str, str]:
    """Version of Python and of every package that can change a result."""
    return {"python": platform.python_version()} | {package: version(package) for package in PACKAGES}


@cache
def sources_sha256() -> str:
    """SHA-256 of the Python files of labctl, checkout or not, as this process first found them."""
    digest = hashlib.sha256()
    for path in sorted(path for package in SOURCES for path in (_ROOT / package).rglob("*.py")):
        content = hashlib.sha256(path.read_bytes()).hexdigest()
        digest.update(f"{path.relative_to(_ROOT).as_posix()} {content}\n".encode())
    return digest.hexdigest()


def this_version() -> str:
    """Version of the distribution, and the revision of the checkout that it runs from, if it does."""
    revision = git_revision()
    return version(DISTRIBUTION) + (f", git {revision}" if revision else "")


@cache
def git_revision() -> str | None:
    """The commit of the checkout that labctl runs from, with "-dirty" for local changes; None outside a checkout.

    As this process first found it.
    """
    if not (_ROOT / ".git").exists():
        return None
    command = ["git", "-C", str(_ROOT), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, check=True, timeout=10)  # noqa: S603
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()
