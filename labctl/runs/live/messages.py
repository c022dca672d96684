"""The last messages to and from instruments: the end of commands.log, as far back as somebody looks."""

import os
from dataclasses import dataclass
from pathlib import Path

from labctl.runs.format.own_files import own_file

TAIL_BYTES = 1 << 16


@dataclass(frozen=True)
class Message:
    """What was said: when (s since the log began, as text), `>` to or `<` from which instrument, and what.

    `=` and `!` of "run" are no messages: that earlier ones were said again, and that something went wrong.
    """

    time_s: str
    sign: str
    instrument: str
    text: str


def last_messages(path: Path) -> list[Message]:
    """The messages in the last `TAIL_BYTES` of a log, in their order; none where there is no log."""
    try:
        with own_file(path) as file:
            begin = max(0, file.seek(0, os.SEEK_END) - TAIL_BYTES)
            file.seek(begin)
            lines = (file.read(TAIL_BYTES) or b"").decode(errors="replace").splitlines()
    except OSError:
        return []
    found = []
    for line in lines[1 if begin else 0 :]:
        time_s, sign, instrument, text = [*line.split(maxsplit=3), "", "", "", ""][:4]
        found.append(Message(time_s, sign, instrument, text))
    return found
