"""A process of labctl that is copied is the one that would have started anew."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from labctl.bench import supervision
from labctl.dashboard import launcher
from tests.clusters import DASK
from tests.forked_processes import STARTED_ANEW, TYPED, ForkedPopen, as_copy

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has copies")

LABCTL = (sys.executable, "-c", TYPED)
SERVE = (*LABCTL, "sim", "serve", "--json")


@pytest.mark.parametrize(
    "command", [supervision.COMMAND, launcher.COMMAND, DASK, LABCTL, (sys.executable, "-m", "labctl")]
)
def test_what_labctl_and_its_tests_start_is_copied_unless_it_would_start_otherwise(
    command: tuple[str, ...], tmp_path: Path
) -> None:
    asked = as_copy((*command, "one", "two"), None, ())
    assert asked is not None
    assert asked.words == ("one", "two")
    assert as_copy(command, os.environ | {"PYTHONHASHSEED": "1"}, ()) is None
    assert as_copy(command, os.environ | {"PYTHONPATH": str(tmp_path)}, ()) is not None
    (tmp_path / "own.py").touch()
    assert as_copy(command, os.environ | {"PYTHONPATH": str(tmp_path)}, ()) is not None
    (tmp_path / "h5py.py").touch()
    assert as_copy(command, os.environ | {"PYTHONPATH": str(tmp_path)}, ()) is None
    assert as_copy(("python", *command[1:]), None, ()) is None


@pytest.mark.parametrize(
    "words",
    [
        ("--version",),
        ("schema", "image-readout"),
        ("psychic",),
        ("runs", "not-there"),
        ("run", "image-readout", "--dry-run", "--json"),
    ],
)
def test_it_prints_and_ends_alike(words: tuple[str, ...], tmp_path: Path) -> None:
    copied, anew = (
        start((*LABCTL, *words), cwd=tmp_path, env=os.environ | {"COLUMNS": "70"}, stdout=-1, stderr=-1, text=True)
        for start in (ForkedPopen, STARTED_ANEW)
    )
    assert copied.communicate() == anew.communicate()
    assert copied.returncode == anew.returncode


def test_it_is_a_child_with_its_own_session_and_files_that_is_killed_like_any_other(tmp_path: Path) -> None:
    kept, released = os.pipe()
    with subprocess.Popen(SERVE, stdout=-1, cwd=tmp_path, start_new_session=True, pass_fds=[released]) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        os.close(released)
        about = Path("/proc", str(process.pid))
        assert ForkedPopen.__module__.encode() in about.joinpath("cmdline").read_bytes(), "it is a copy"
        assert int(about.joinpath("stat").read_text().rpartition(")")[2].split()[1]) == os.getpid()
        assert os.getsid(process.pid) == process.pid
        assert about.joinpath("cwd").readlink() == tmp_path
        assert about.joinpath("fd", str(released)).exists()
        process.kill()
        assert process.wait() == -signal.SIGKILL
    with open(kept, "rb") as end:
        assert end.read() == b"", "nobody else holds its files"
