"""Progress on standard error."""

import io

import pytest
from rich.console import Console
from rich.progress import Progress

from instruments.safe_state import UnsafeBench
from labctl.commands import progress
from labctl.commands.progress import COLUMNS, ProgressLine, progress_bar


def shown_on(seen: io.StringIO) -> Console:
    """A terminal."""
    return Console(file=seen, force_terminal=True, width=100, legacy_windows=False)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What a person at a terminal sees on standard error."""
    seen = io.StringIO()
    monkeypatch.setattr(progress, "errors", shown_on(seen))
    return seen


def test_the_line_says_what_is_uploaded_and_then_goes_on() -> None:
    terminal = io.StringIO()
    with Progress(*COLUMNS, console=shown_on(terminal), auto_refresh=False) as bar:
        line = ProgressLine(bar, "image-readout", print)
        line.uploading("DMD patterns", 250, 1000)
        line.draw()
        line.uploading("DMD patterns", 1000, 1000)
        line.progress(7, 88)
        line.draw()
    seen = terminal.getvalue()
    upload, measuring = seen.index("uploading DMD patterns"), seen.index("7/88")
    assert "250/1000" in seen[upload:measuring]
    assert "image-readout" in seen[upload:measuring]
    assert "uploading" not in seen[measuring:]


def test_nothing_where_nobody_sees_it(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = io.StringIO()
    monkeypatch.setattr(progress, "errors", Console(file=seen, force_terminal=False))
    with progress_bar("image-readout") as line:
        line.uploading("waveform", 1, 2)
        line.progress(1, 2)
    assert not seen.getvalue()


def test_a_laser_that_did_not_go_dark_is_said_in_red(terminal: io.StringIO) -> None:
    with progress_bar("image-readout") as line:
        line.safe_state(UnsafeBench("the scope did not stop", ["scope"]))
        line.safe_state(UnsafeBench("the laser may still emit", ["laser"]))
    assert "\x1b[1;31mlabctl: the laser may still emit" in terminal.getvalue()
    assert "the scope did not stop" not in terminal.getvalue()
