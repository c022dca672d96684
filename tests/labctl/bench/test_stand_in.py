"""Who is told of the end of a supervisor's copy."""

import subprocess
import sys

import pytest

COPIED = """
import io, os, signal, sys, threading
from pathlib import Path
from labctl.bench.stand_in import with_a_copy

supervisor = os.getpid()
followed = with_a_copy(io.FileIO(0), lambda: print("left alone"))
if os.getpid() != supervisor:
    list(followed.lines)
    os._exit(0)
if sys.argv[1] == "dismissed":
    followed.dismiss()
else:
    (copy,) = Path(f"/proc/{supervisor}/task/{supervisor}/children").read_text().split()
    os.kill(int(copy), signal.SIGKILL)
for thread in threading.enumerate():
    if thread is not threading.current_thread():
        thread.join()
"""
"""Has a copy of itself end, and waits until all is said of that."""


@pytest.mark.skipif(sys.platform != "linux", reason="where there is a copy, and the system tells its number")
@pytest.mark.parametrize(("end", "told"), [("dismissed", ""), ("killed", "left alone\n")])
def test_who_has_dismissed_its_copy_is_not_told_that_it_has_ended(end: str, told: str) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", COPIED, end], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=True
    )
    assert ended.stdout == told
