"""What `make audit` makes of a report, and of the lack of one."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.audit import NOT_CHECKED, NotChecked, environment, known, report
from tests.checkout import ROOT

WHOLE = {
    "dependencies": [
        {"name": "safe", "version": "1.0", "vulns": []},
        {"name": "old", "version": "2.0", "vulns": [{"id": "PYSEC-1", "fix_versions": ["2.1"]}]},
        {"name": "older", "version": "3.0", "vulns": [{"id": "PYSEC-2", "fix_versions": []}]},
    ]
}


def test_each_vulnerability_is_a_line() -> None:
    assert known(json.dumps(WHOLE), "a.lock") == [
        "a.lock: old 2.0: PYSEC-1: mended in 2.1",
        "a.lock: older 3.0: PYSEC-2: mended in no version yet",
    ]


def test_a_package_left_out_is_no_success() -> None:
    left_out = {"dependencies": [{"name": "mine", "skip_reason": "not found"}]}
    with pytest.raises(NotChecked, match=r"a\.lock: mine: not found"):
        known(json.dumps(left_out), "a.lock")


def test_what_is_installed_is_looked_at_with_the_installer_and_without_what_is_built_here() -> None:
    names = [line.partition("==")[0].lower() for line in environment()]
    assert "pip" in names
    assert "numpy" in names
    assert "photonic-labctl" not in names
    assert not any("+" in line for line in environment()), "advisories know a version, not its builds"


def test_without_the_tool_nothing_was_checked(tmp_path: Path) -> None:
    """The environment of the tests has no pip-audit."""
    with pytest.raises(NotChecked, match="cannot be reached"):
        report(Path(sys.executable), "a.lock")


def test_where_it_cannot_be_checked_one_line_says_so_and_the_status_is_its_own(tmp_path: Path) -> None:
    python = tmp_path / "bin" / "python"
    python.parent.mkdir()
    python.symlink_to(sys.executable)
    (tmp_path / ".installed").touch()
    ended = subprocess.run(
        [sys.executable, "-m", "tests.audit", str(tmp_path), "requirements.lock"],
        cwd=ROOT,
        check=False,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == NOT_CHECKED
    assert ended.stdout.startswith("audit: not checked: requirements.lock: the advisory data cannot be reached (")
    assert ended.stdout.count("\n") == 1
