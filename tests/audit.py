"""`make audit`: are versions that the lock files pin, or that are installed, known to be vulnerable?

Exit status 0: none is. 1: some are, a line each. 3: it could not be checked, because pip-audit cannot be installed or
the advisory data cannot be reached. Usage: `python -m tests.audit FOLDER LOCK...`; pip-audit is installed in FOLDER,
apart from the project's own environment, which is looked at too: pip and setuptools come into it before any lock file.
"""

import json
import subprocess
import sys
import venv
from collections.abc import Sequence
from importlib.metadata import distributions
from pathlib import Path

from packaging.version import Version

TOOL = "pip-audit==2.10.1"
NONE_KNOWN, SOME_KNOWN, NOT_CHECKED = 0, 1, 3
OPTIONS = ("--disable-pip", "--no-deps", "--format", "json", "--progress-spinner", "off")


class NotChecked(Exception):
    """The check could not be made; why, in one line."""


def main(folder: Path, locks: Sequence[str]) -> int:
    """Check the packages of all `locks`; prints what is to be known about them."""
    try:
        python = installed(folder)
        listed = folder / "environment.txt"
        listed.write_text("".join(f"{line}\n" for line in environment()), encoding="utf-8")
        locks = [*locks, str(listed)]
        found = [line for lock in locks for line in known(report(python, lock), lock)]
    except NotChecked as error:
        print(f"audit: not checked: {error}")  # noqa: T201
        return NOT_CHECKED
    for line in found:
        print(line)  # noqa: T201
    print(f"audit: {len(found)} known vulnerabilities in {', '.join(locks)}")  # noqa: T201
    return SOME_KNOWN if found else NONE_KNOWN


def installed(folder: Path) -> Path:
    """The Python of an environment in `folder` that has pip-audit; made if it is not there.

    Raises:
        NotChecked: no registry has it.
    """
    python = folder / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    if not (folder / ".installed").exists():
        venv.create(folder, with_pip=True)
        ended = _run([str(python), "-m", "pip", "install", "--quiet", "--disable-pip-version-check", TOOL])
        if ended.returncode:
            raise NotChecked(f"{TOOL} cannot be installed ({_last_line(ended.stderr)})")
        (folder / ".installed").touch()
    return python


def environment() -> list[str]:
    """What this Python has from an index: name==version, without what tells builds of one version apart."""
    found = (one for one in distributions() if one.read_text("direct_url.json") is None)
    return sorted(f"{one.name}=={Version(one.version).public}" for one in found)


def report(python: Path, lock: str) -> str:
    """What pip-audit finds in one lock file, as JSON.

    Raises:
        NotChecked: it finds nothing out.
    """
    ended = _run([str(python), "-m", "pip_audit", "--requirement", lock, *OPTIONS])
    if not ended.stdout.startswith("{"):
        raise NotChecked(f"{lock}: the advisory data cannot be reached ({_last_line(ended.stderr)})")
    return ended.stdout


def known(report: str, lock: str) -> list[str]:
    """One line for each known vulnerability in a report of pip-audit.

    Raises:
        NotChecked: the report leaves a package out.
    """
    found = []
    for package in json.loads(report)["dependencies"]:
        if "skip_reason" in package:
            raise NotChecked(f"{lock}: {package['name']}: {package['skip_reason']}")
        for vulnerability in package["vulns"]:
            remedy = ", ".join(vulnerability["fix_versions"]) or "no version yet"
            found.append(f"{lock}: {package['name']} {package['version']}: {vulnerability['id']}: mended in {remedy}")
    return found


def _run(words: list[str]) -> subprocess.CompletedProcess[str]:
    return subprocess.run(words, capture_output=True, text=True, check=False)


def _last_line(text: str) -> str:
    return next(reversed([line.strip() for line in text.splitlines() if line.strip()]), "no reason given")[:300]


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
