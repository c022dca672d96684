"""A disk that takes nothing, and a process that may open nothing: one line that says what to do about just that."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from labctl.commands.main import main
from tests.checkout import ROOT
from tests.system.test_full_disk import APART

SETTINGS = ("classes=0,1", "images=40", "window=0.4 ns", "ports=2,3", "reference_every=20")
ADVICE = {
    "full": ("make room",),
    "read-only": ("Read-only file system", "use a place that may be written to"),
    "few-files": ("Too many open files", "ulimit -n"),
}


Said = dict[str, tuple[int, str, str]]
"""Exit status, output and errors of each command."""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run with a readout."""
    directory = tmp_path / "runs" / "run"
    words = [word for one in SETTINGS for word in ("--set", one)]
    for command in (["run", "image-readout", *words, "--out", str(directory)], ["train", str(directory)]):
        with pytest.raises(SystemExit) as ended:
            main(command)
        assert ended.value.code == 0
    return directory


def test_every_command_that_writes_says_what_to_do(run: Path, tmp_path: Path) -> None:
    if shutil.which("unshare") is None or subprocess.run([*APART, "true"], check=False).returncode:
        pytest.skip("no file system may be mounted here")
    script = Path(__file__).with_name("on_a_closed_disk.py")
    ended = subprocess.run(
        [*APART, sys.executable, str(script), str(tmp_path), str(run), *ADVICE],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    said: dict[str, Said] = json.loads(ended.stdout)
    for what, advice in ADVICE.items():
        refused = {name: found for name, found in said[what].items() if found[0]}
        allowed = {"show", "init", "schema"} if what != "few-files" else set(said[what])
        assert set(said[what]) - set(refused) <= allowed, what
        for name, (status, out, err) in refused.items():
            first = next(line for line in err.splitlines() if line.startswith("labctl: "))
            assert status in (1, 2), (what, name)
            assert all(part in first for part in advice), (what, name, first)
            assert "Traceback" not in err, (what, name)
            assert "did not expect" not in err, (what, name)
            assert json.loads(out)["error"] == first.removeprefix("labctl: "), (what, name)
