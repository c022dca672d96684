"""A protocol in a file that is named on the command line: run, killed, gone on with, swept, put into a queue."""

import hashlib
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from labctl.runs.read.run import open_run
from tests.checkout import ROOT
from tests.command_line import answer
from tests.system.waiting import until_stored

EXAMPLE = ROOT / "docs" / "how-to" / "examples" / "bench_extras.py"
READOUT = '''"""Digits, under a name of their own."""

from typing import ClassVar

from protocols.image_readout import ImageReadout


class Mine(ImageReadout):
    """As the protocol it is made of."""

    name: ClassVar[str] = "mine"
'''
LABCTL = [sys.executable, "-m", "labctl"]


def run(*words: object) -> tuple[int, dict[str, Any], str]:
    """A command, `--json` right behind it."""
    behind = 2 if words[0] == "queue" else 1
    return answer(*words[:behind], "--json", *words[behind:])


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    path = tmp_path / "mine.py"
    path.write_text(EXAMPLE.read_text("utf-8"), encoding="utf-8")
    return path


@pytest.fixture
def long(mine: Path) -> tuple[str, ...]:
    """A run whose frames are the same whenever they are measured: of a protocol that shows many pictures."""
    mine.write_text(READOUT, encoding="utf-8")
    station = mine.with_name("station.toml")
    station.write_text('[sim]\nnoise = "by-state"\n', encoding="utf-8")
    return "run", str(mine), "--set", "images=400", "--set", "ports=2", "--station", str(station)


def killed(long: tuple[str, ...], out: Path) -> None:
    process = subprocess.Popen([*LABCTL, *long, "--out", str(out)])
    try:
        until_stored(process, out, shards=8)
    finally:
        process.kill()
        process.wait()


def test_it_goes_on_to_the_frames_of_one_that_was_never_killed(
    mine: Path, long: tuple[str, ...], tmp_path: Path
) -> None:
    status, whole, _ = run(*long, "--out", tmp_path / "whole")
    assert (status, whole["next"]) == (0, f"labctl train {tmp_path / 'whole'}")
    with open_run(tmp_path / "whole") as stored:
        assert stored.manifest["protocol"]["file"] == {
            "path": str(mine),
            "sha256": hashlib.sha256(mine.read_bytes()).hexdigest(),
            "text": mine.read_text("utf-8"),
        }
    killed(long, tmp_path / "killed")
    text = mine.read_text("utf-8")
    mine.write_text(text + "\n# changed\n", encoding="utf-8")
    status, refused, _ = run("resume", tmp_path / "killed")
    assert status == 2
    assert "no run was begun here with the protocol" in refused["error"]
    assert "\n" not in refused["error"]
    mine.unlink()
    status, refused, _ = run("resume", tmp_path / "killed")
    assert (status, "mine.py: cannot be read" in refused["error"]) == (2, True)
    mine.write_text(text, encoding="utf-8")
    status, found, _ = run("resume", tmp_path / "killed")
    assert (status, found["complete"], found["measured"] < 400) == (0, True, True)
    assert found["frames_sha256"] == whole["frames_sha256"]
    assert run("verify", tmp_path / "killed")[0] == 0


def test_a_strangers_run_has_nothing_executed(
    mine: Path, long: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    planted = f"\nopen({str(tmp_path / 'executed')!r}, 'w').close()\n"
    mine.write_text(mine.read_text("utf-8") + planted, encoding="utf-8")
    killed(long, tmp_path / "theirs")
    (tmp_path / "executed").unlink()
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "another user"))
    bench = ("--station", tmp_path / "station.toml")
    for words in (("resume",), ("show",), ("verify",), ("report",)):
        run(*words, tmp_path / "theirs")
    status, refused, _ = run("resume", tmp_path / "theirs", *bench)
    assert (status, "with the protocol" in refused["error"]) == (2, True)
    assert not (tmp_path / "executed").exists()


def test_what_fails_while_it_measures_is_told_with_its_line(mine: Path, tmp_path: Path) -> None:
    text = mine.read_text("utf-8")
    place = text[: text.index("yield Record")].count("\n") + 1
    mine.write_text(text.replace("yield Record(", "yield Recrod("), encoding="utf-8")
    status, found, _ = run("run", mine, "--out", tmp_path / "wrong")
    assert status == 1
    assert found["error"].startswith(f"{mine}, line {place}: NameError: name 'Recrod' is not defined: correct")


def test_it_is_swept_and_queued_like_any_other(mine: Path, tmp_path: Path) -> None:
    words = ("sweep", mine, "--set", "repeats=5", "--over", "power=10 mW,30 mW", "--out", tmp_path / "swept")
    status, found, _ = run("queue", "add", "--folder", tmp_path, *words[:-2])
    assert (status, found["plan"]["shots"]) == (0, 15)
    status, found, _ = run(*words)
    assert (status, found["complete"]) == (0, 3)
    assert run("resume", tmp_path / "swept")[1]["measured"] == 0
    assert run("queue", "start", "--folder", tmp_path)[1] == {"done": 1, "failed": 0, "waiting": 0}
    run("queue", "add", "--folder", tmp_path, "run", mine, "--set", "repeats=5")
    mine.write_text(mine.read_text("utf-8") + "\n# changed\n", encoding="utf-8")
    assert run("queue", "start", "--folder", tmp_path)[1] == {"done": 0, "failed": 1, "waiting": 0}
    assert (
        "is not what it was when this was added" in run("queue", "list", "--folder", tmp_path)[1]["items"][1]["message"]
    )
