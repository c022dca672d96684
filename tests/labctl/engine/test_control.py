"""Pausing and stopping a run from another process, by the file `control` of its directory."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.signals import Interruption, StoppedBySignal
from labctl.bench.station import SimSection, Station, WiringSection
from labctl.engine.control import Control, controlled
from labctl.engine.session import Acquisition, acquire
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.events import EventReader
from labctl.runs.read.run import open_run
from protocols.image_readout import ImageReadout
from tests.observers import Follower

BURSTS = Station(wiring=WiringSection(burst=True))
BY_STATE = BURSTS.model_copy(update={"sim": SimSection(noise="by-state")})
"""What was measured before changes no frame."""
SOFTWARE = ImageReadout(images=10, reference_every=3, window=0.8e-9)
ONE_LEG = ImageReadout(images=5, reference_every=3, window=0.8e-9, ports=(2,))
BURST = ImageReadout(images=20, timing="burst", window=0.8e-9)


def asking(directory: Path, **words: Word) -> Callable[[int, int], None]:
    """Ask for a word when so many records are done: `at_3=Word.PAUSE`."""
    at = {int(name.removeprefix("at_")): word for name, word in words.items()}

    def progress(done: int, _total: int) -> None:
        if done in at:
            ask(directory, at[done])

    return progress


def told(directory: Path) -> list[str]:
    return [event.name for event in EventReader(directory / "events.jsonl").read()]


def frames(directory: Path) -> str:
    with open_run(directory) as run:
        return run.digest()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes and links")
@pytest.mark.parametrize("make", [lambda path, _word: os.mkfifo(path), lambda path, word: path.symlink_to(word)])
def test_what_is_no_file_asks_nothing_and_is_not_waited_for(make: Callable[[Path, Path], None], tmp_path: Path) -> None:
    (tmp_path / "word").write_text(Word.STOP)
    make(tmp_path / "control", tmp_path / "word")
    control = Control(tmp_path / "control", Interruption())
    assert (control.holds, control.paused, control.stopped) == (False, False, False)


@pytest.mark.parametrize(
    ("protocol", "records"), [pytest.param(SOFTWARE, 3, marks=pytest.mark.full), (SOFTWARE, 25), (BURST, 22)]
)
def test_a_paused_run_is_dark_and_goes_on_to_the_same_frames(protocol: Any, records: int, tmp_path: Path) -> None:
    run = tmp_path / "run"
    waited: list[str] = []

    def wait(_seconds: float) -> None:
        waited[:] = told(run)
        ask(run, Word.GO_ON)

    acquire(Acquisition(protocol, BY_STATE, tmp_path / "whole"))
    acquired = acquire(
        Acquisition(protocol, BY_STATE, run),
        interruption=Interruption(wait=wait),
        observer=Follower(asking(run, **{f"at_{records}": Word.PAUSE})),
    )
    assert acquired.outcome.complete
    assert [name for name in waited if name in ("safe state", "paused")] == ["safe state", "paused"]
    assert told(run).count("going on") == 1
    assert frames(run) == frames(tmp_path / "whole")
    with open_run(run) as stored:
        assert stored.epoch.max() == 2, "two passes and one pause"
    assert not (run / "control").exists()


def test_a_pause_after_the_last_record_is_none(tmp_path: Path) -> None:
    def never(_seconds: float) -> None:
        raise AssertionError

    acquired = acquire(
        Acquisition(ONE_LEG, BURSTS, tmp_path / "run"),
        interruption=Interruption(wait=never),
        observer=Follower(lambda done, total: ask(tmp_path / "run", Word.PAUSE) if done == total else None),
    )
    assert acquired.outcome.complete


def test_ctrl_c_ends_a_paused_run(tmp_path: Path) -> None:
    interruption = Interruption()

    def ctrl_c(_seconds: float) -> None:
        interruption.requested = True

    interruption.wait = ctrl_c
    acquired = acquire(
        Acquisition(ONE_LEG, BURSTS, tmp_path / "run"),
        interruption=interruption,
        observer=Follower(asking(tmp_path / "run", at_3=Word.PAUSE)),
    )
    assert not acquired.outcome.complete
    with open_run(tmp_path / "run") as stored:
        assert stored.done == (3,)
    assert "going on" not in told(tmp_path / "run")


def test_stop_finishes_the_record(tmp_path: Path) -> None:
    acquired = acquire(
        Acquisition(ONE_LEG, BURSTS, tmp_path / "run"), observer=Follower(asking(tmp_path / "run", at_4=Word.STOP))
    )
    assert not acquired.outcome.complete
    with open_run(tmp_path / "run") as stored:
        assert stored.done == (4,)


def test_stop_now_ends_in_the_safe_state(tmp_path: Path) -> None:
    with pytest.raises(StoppedBySignal):
        acquire(
            Acquisition(ONE_LEG, BURSTS, tmp_path / "run"),
            observer=Follower(asking(tmp_path / "run", at_4=Word.STOP_NOW)),
        )
    assert told(tmp_path / "run")[-2:] == ["safe state", "stopped"]


@pytest.mark.parametrize("content", [None, b"", b"dance", b"\xff\xfe", b"pause" * 1000, b"go on\n"])
def test_what_is_no_word_holds_nothing(content: bytes | None, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / "control").write_bytes(content)
    control = Control(tmp_path / "control", Interruption())
    assert (control.holds, control.paused, control.stopped) == (False, False, False)


def test_a_word_from_an_earlier_time_means_nothing(tmp_path: Path) -> None:
    ask(tmp_path, Word.STOP)
    with controlled(tmp_path, Interruption()) as control:
        assert not control.holds
        ask(tmp_path, Word.STOP)
        assert control.holds
        assert control.stopped
    assert list(tmp_path.iterdir()) == []
