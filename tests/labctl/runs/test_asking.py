"""What is asked of a run from outside."""

import os
import signal
import sys
from pathlib import Path

import pytest

from labctl.runs.asking import stop_at_once
from labctl.runs.live.control_file import CONTROL, Word, word_in


def test_a_signal_is_enough_where_the_word_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sent: list[tuple[int, int]] = []
    monkeypatch.setattr(os, "kill", lambda process, number: sent.append((process, number)))
    (tmp_path / CONTROL).mkdir()
    stop_at_once(tmp_path, 4711)
    assert sent == [(4711, signal.SIGTERM)]
    with pytest.raises(IsADirectoryError):
        stop_at_once(tmp_path, None)


def test_on_windows_no_process_is_signalled_and_a_word_that_cannot_be_written_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A signal would kill the run there."""
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(os, "kill", lambda *_: pytest.fail("the run is killed"))
    stop_at_once(tmp_path, 4711)
    assert word_in(tmp_path) is Word.STOP_NOW
    (tmp_path / CONTROL).unlink()
    (tmp_path / CONTROL).mkdir()
    with pytest.raises(IsADirectoryError):
        stop_at_once(tmp_path, 4711)
