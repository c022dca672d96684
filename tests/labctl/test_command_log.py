"""commands.log."""

from pathlib import Path

from labctl.command_log import CommandLog


def test_messages_before_and_after_the_file_is_there(tmp_path: Path) -> None:
    ticks = iter([10.0, 10.5, 11.25])
    path = tmp_path / "commands.log"
    with CommandLog(clock=lambda: next(ticks)) as log:
        log("awg", ">", "*IDN?")
        log.keep_in(path)
        log("awg", "<", 'two\r\nlines"')
    assert path.read_text() == '0.500000 > awg *IDN?\n1.250000 < awg two\\r\\nlines"\n'


def test_without_a_file_nothing_is_left() -> None:
    with CommandLog() as log:
        log("awg", ">", "*IDN?")
