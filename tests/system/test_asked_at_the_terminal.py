"""What a person at the bench is asked for stays on the terminal, whatever else is drawn there."""

import os
import re
import subprocess
import sys
import termios
from pathlib import Path

import pytest

from tests.system.test_interrupted import IN_A_TERMINAL

BY_HAND = """\
mixed = true
[laser]
driver = "manual-laser"
armed = true
[patch_panel]
driver = "manual-patch-panel"
ports = "2-5"
"""
RUN = ("run", "image-readout", "--set=images=4", "--set=ports=2", "--set=window=0.4 ns", "--out={}/run")
CONNECT, POWER, WAVELENGTH = "connect port 2 to CH1", "Set the laser to 30 mW", "Set the laser to 1550 nm"
ON, OFF = "switch the laser ON", "Switch the laser OFF"


def on_the_screen(written: str) -> list[str]:
    """The lines of a terminal after what a program has written: where the cursor goes, and what is erased."""
    lines, row, column = [""], 0, 0
    for part in re.split(r"(\x1b\[[?0-9;]*[A-Za-z]|[\r\n])", written):
        if part == "\r":
            column = 0
        elif part == "\n":
            row += 1
            lines += [""] * (row == len(lines))
        elif not part.startswith("\x1b"):
            lines[row] = lines[row][:column].ljust(column) + part + lines[row][column + len(part) :]
            column += len(part)
        elif part.endswith("A"):
            row -= int(part[2:-1])
        elif part.endswith("K"):
            lines[row] = ""
    return lines


@pytest.mark.parametrize(
    ("words", "requests"),
    [
        pytest.param(RUN, (POWER, WAVELENGTH, CONNECT, ON, OFF), id="run"),
        pytest.param(
            ("live", "--for=1 s", "--runs={}"), (CONNECT, POWER, WAVELENGTH, ON, OFF), id="live", marks=pytest.mark.full
        ),
    ],
)
def test_each_request_stands_on_a_line_of_its_own_and_stays(
    words: tuple[str, ...], requests: tuple[str, ...], tmp_path: Path
) -> None:
    station = tmp_path / "by-hand.toml"
    station.write_text(BY_HAND, encoding="utf-8")
    command = [
        sys.executable,
        "-c",
        IN_A_TERMINAL,
        *(word.format(tmp_path) for word in words),
        f"--station={station}",
        "--attended",
    ]
    ours, its = os.openpty()
    termios.tcsetwinsize(its, (50, 160))
    at_it = os.environ | {"TERM": "xterm"}
    with subprocess.Popen(command, stdin=its, stdout=its, stderr=its, env=at_it, start_new_session=True) as process:
        os.close(its)
        written = b""
        try:
            for number in range(len(requests)):
                while written.count(b"press Enter: ") == number:
                    written += os.read(ours, 65536)
                shown = on_the_screen(written.decode(errors="replace"))
                asked = [line for line in shown if "press Enter" in line]
                assert len(asked) == number + 1, "\n".join(shown)
                for line, wanted in zip(asked, requests, strict=False):
                    assert re.fullmatch(f"([^,]*, [^,]*)?{wanted}.*, then press Enter: *", line)
                os.write(ours, b"\n")
        finally:
            process.kill()
    os.close(ours)
