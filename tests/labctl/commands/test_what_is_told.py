"""What a command tells where something about the command itself is unusual: its words, its output, what it is given."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.command_line import LABCTL, as_json, labctl

FULL = Path("/dev/full")
SMALL = ("run", "image-readout", "--set", "images=4", "--set", "ports=2", "--set", "window=0.4 ns")


def test_without_a_command_the_help_is_shown_as_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    status, _, told = labctl(capsys)
    assert status == 2
    assert told.startswith("Usage: labctl [OPTIONS] COMMAND [ARGS]...\n\n")
    assert labctl(capsys, "run", "--foo")[2].endswith("`labctl run --help` lists what there is\n")


def test_a_closed_output_takes_what_is_printed_to_nowhere(tmp_path: Path) -> None:
    words = (*LABCTL, "runs", str(tmp_path))
    done = subprocess.run(
        [shutil.which("sh") or "sh", "-c", 'exec "$@" >&-', "sh", *words], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_no_file_gets_the_place_of_a_closed_stream(tmp_path: Path) -> None:
    script = tmp_path / "opened.py"
    script.write_text(
        "import os, sys\n"
        "from labctl.commands import main\n"
        "main.app = lambda *words, **options: sys.stdout.write(str(os.open(os.devnull, os.O_RDONLY))) and 0\n"
        "main.main(['runs'])\n",
        encoding="utf-8",
    )
    words = (shutil.which("sh") or "sh", "-c", 'exec "$@" <&- 2>&-', "sh", sys.executable, str(script))
    done = subprocess.run(words, capture_output=True, text=True, check=True)
    assert int(done.stdout) > 2


@pytest.mark.skipif(not FULL.exists(), reason="a device that takes nothing")
def test_a_run_whose_warnings_cannot_be_shown_goes_on(tmp_path: Path) -> None:
    station = tmp_path / "bench.toml"
    noisy = "[sim]\nparameters = { detector_nep_w_per_rthz = 1e-9 }\n"  # beyond the ranges that the probes find
    station.write_text(noisy, encoding="utf-8")
    words = [*LABCTL, *SMALL, "--station", str(station), "--json", "--out"]
    told = subprocess.run([*words, str(tmp_path / "told")], capture_output=True, text=True, check=True).stderr
    assert told.startswith("labctl: "), "there is something to be told"
    with FULL.open("w") as full:
        done = subprocess.run([*words, str(tmp_path / "run")], stdout=subprocess.PIPE, stderr=full, check=False)
    assert (done.returncode, json.loads(done.stdout)["complete"]) == (0, True)


@pytest.mark.parametrize("options", [(), ("--json",)])
@pytest.mark.skipif(not FULL.exists(), reason="a device that takes nothing")
def test_a_result_that_cannot_be_shown_is_told_apart_from_a_run_that_is_not_whole(
    options: tuple[str, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = (*LABCTL, *SMALL, "--out", str(tmp_path / "run"), *options)
    with FULL.open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr.splitlines()) == (
        1,
        [
            "labctl: standard output: No space left on device: make room",
            "labctl: the command itself is done: what it made is kept",
        ],
    )
    assert as_json(capsys, "show", tmp_path / "run")[1]["complete"]


def test_what_an_encoding_lacks_is_escaped(tmp_path: Path) -> None:
    (tmp_path / "b\u00b5nch.toml").write_text("no", encoding="utf-8")
    words = (*LABCTL, "check", "--station", str(tmp_path / "b\u00b5nch.toml"), "--json")
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    done = subprocess.run(words, capture_output=True, env=ascii_only, check=False)
    assert done.returncode == 2
    assert b"b\\xb5nch.toml: is not TOML" in done.stderr
    assert b"Traceback" not in done.stderr


def test_a_station_whose_path_is_not_utf_8_is_refused_and_one_beside_it_is_used_by_its_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / os.fsdecode(b"b\xe9nk")
    folder.mkdir()
    (folder / "bench.toml").write_text("[wiring]\nburst = true\n", encoding="utf-8")
    for words in (("check",), SMALL):
        status, _, told = labctl(capsys, *words, "--station", folder / "bench.toml")
        assert (status, told.count("\n")) == (2, 1)
        assert told.endswith("b\\udce9nk/bench.toml: this name is not UTF-8: rename that file or folder\n")
    monkeypatch.chdir(folder)
    assert as_json(capsys, *SMALL, "--station", "bench.toml", "--out", tmp_path / "run")[1]["complete"]


def test_debug_adds_the_traceback_and_changes_nothing_else(capsys: pytest.CaptureFixture[str]) -> None:
    plain = labctl(capsys, "check", "--station", "nowhere.toml", "--json")
    status, out, told = labctl(capsys, "check", "--station", "nowhere.toml", "--json", "--debug")
    assert (status, out) == plain[:2]
    assert told.startswith("Traceback")
    assert told.endswith(plain[2])


def test_runs_of_a_folder_that_is_not_there_are_not_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, _, told = labctl(capsys, "runs", tmp_path / "rusn")
    assert (status, told) == (2, f"labctl: {tmp_path / 'rusn'}: no such folder: name one with runs in it\n")


def test_notes_of_what_is_no_run_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = f"labctl: {tmp_path}: not a run directory (no manifest.json in it): name a run\n"
    assert labctl(capsys, "note", tmp_path)[::2] == (2, told)


def test_a_folder_that_is_no_run_is_called_so_whatever_is_in_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "link").symlink_to("/etc/hostname")
    for command in ("verify", "show", "resume"):
        assert "not a run directory" in labctl(capsys, command, tmp_path)[2]
