"""The end of a log of messages, whatever is in it."""

from pathlib import Path

from labctl.runs.live.messages import TAIL_BYTES, Message, last_messages


def test_the_last_messages_are_read(tmp_path: Path) -> None:
    path = tmp_path / "commands.log"
    assert last_messages(path) == []
    path.write_bytes(b"0.5 > awg *IDN?\n0.6 < awg TEKTRONIX,AWG\n0.7 > dmd\n\xff\n")
    assert last_messages(path)[:3] == [
        Message("0.5", ">", "awg", "*IDN?"),
        Message("0.6", "<", "awg", "TEKTRONIX,AWG"),
        Message("0.7", ">", "dmd", ""),
    ]
    path.write_bytes(b"1 > awg lost\n" + b"2 > awg kept\n" * TAIL_BYTES)
    assert {one.text for one in last_messages(path)} == {"kept"}
