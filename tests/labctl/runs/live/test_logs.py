"""commands.log, and the file of lines under both logs."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from labctl.runs.live.logs import CommandLog


def test_messages_before_and_after_the_file_is_there(tmp_path: Path) -> None:
    ticks = iter([10.0, 10.5, 11.25])
    path = tmp_path / "commands.log"
    with CommandLog(clock=lambda: next(ticks)) as log:
        log("awg", ">", "*IDN?")
        log.keep_in(path)
        log("awg", "<", 'two\r\nlines"')
    assert path.read_text() == '0.500000 > awg *IDN?\n1.250000 < awg two\\r\\nlines"\n'


def test_messages_are_told_apart_where_the_monotonic_clock_has_long_steps(tmp_path: Path) -> None:
    """15.6 ms on Windows before Python 3.13; a round is found by the time of its first message."""
    path = tmp_path / "commands.log"
    written = f"""if True:
        import pathlib, time
        time.monotonic = lambda: 0.0
        from labctl.runs.live.logs import CommandLog
        with CommandLog() as log:
            log.keep_in(pathlib.Path({str(path)!r}))
            for number in range(100):
                log("awg", ">", str(number))
    """
    subprocess.run([sys.executable, "-c", written], check=True)
    times = [line.split()[0] for line in path.read_text().splitlines()]
    assert len(times) == 100
    assert float(times[0]) < float(times[-1])


def test_a_line_that_a_killed_process_left_without_its_end_stays_apart(tmp_path: Path) -> None:
    path = tmp_path / "commands.log"
    path.write_text("0.5 > awg *ID")
    with CommandLog(clock=lambda: 12.0, started=10.0) as log:
        log.keep_in(path)
        assert log.path == path
        log("awg", ">", "*IDN?")
    assert path.read_text() == "0.5 > awg *ID\n2.000000 > awg *IDN?\n"


def test_without_a_file_nothing_is_left() -> None:
    with CommandLog() as log:
        log("awg", ">", "*IDN?")


def test_a_full_disk_ends_the_log_and_nothing_else(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    resource = pytest.importorskip("resource", reason="needs a limit on the size of files")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with CommandLog() as log:
        log.keep_in(tmp_path / "commands.log")
        resource.setrlimit(resource.RLIMIT_FSIZE, (50_000, limits[1]))
        try:
            for _ in range(2):
                log.warning("x" * 100_000)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert caplog.messages == ["commands.log cannot be written (File too large): it ends here"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs links and pipes")
@pytest.mark.parametrize("made", [lambda path: path.symlink_to(path.with_name("secret")), lambda path: os.mkfifo(path)])
def test_a_log_goes_into_no_other_file(tmp_path: Path, made: Callable[[Path], object]) -> None:
    path, secret = tmp_path / "commands.log", tmp_path / "secret"
    secret.write_bytes(b"secret")
    made(path)
    with CommandLog() as log, pytest.raises(OSError, match=r"link to another place|pipe"):
        log.keep_in(path)
    assert secret.read_bytes() == b"secret"


def test_a_log_that_cannot_be_opened_is_told(tmp_path: Path) -> None:
    with CommandLog() as log, pytest.raises(FileNotFoundError):
        log.keep_in(tmp_path / "no" / "commands.log")
