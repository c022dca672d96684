"""Supervisors that are forked from a process which has loaded all that they need: each would take half a second for it.

What a test of supervisors is about starts as it does for a user; this is for tests that make hundreds of runs.

Usage: `python -m tests.forked_supervisors ADDRESS`: serves processes that execute `ASKS` until its standard input ends.
"""

import os
import selectors
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

from labctl.bench import supervisor
from labctl.bench.station import SIMULATED_STATION, USUAL

ASKS = """
import os, socket, sys
link = socket.socket(socket.AF_UNIX)
link.connect(sys.argv[1])
files = [number for number in range(256) if number != link.fileno() and os.path.exists(f"/proc/self/fd/{number}")]
socket.send_fds(link, [bytes(files)], files)
for number in files:
    os.close(number)
os._exit(link.recv(1)[0])
"""
"""A process that stands for a supervisor: it has the other's files, ends with its status, and ends it when killed."""
MOST_FILES = 64


@contextmanager
def forked() -> Iterator[None]:
    """Runs of this process have such supervisors inside the block."""
    if sys.platform != "linux":
        yield
        return
    with TemporaryDirectory() as folder:
        address = Path(folder) / "supervisors"
        command = [sys.executable, "-m", "tests.forked_supervisors", str(address)]
        asks = (sys.executable, "-I", "-S", "-c", ASKS, str(address))
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as served:
            assert served.stdout is not None
            assert served.stdout.readline() == b"listening\n"
            with patch("labctl.bench.supervision.COMMAND", asks):
                yield


def serve(address: str) -> None:
    """Fork whoever is asked for until standard input ends."""
    for name in USUAL:
        SIMULATED_STATION.driver_of(name)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    with socket.socket(socket.AF_UNIX) as listening, selectors.DefaultSelector() as events:
        listening.bind(address)
        listening.listen()
        os.write(1, b"listening\n")
        events.register(0, selectors.EVENT_READ)
        events.register(listening, selectors.EVENT_READ)
        while all(key.fileobj != 0 for key, _ in events.select()):
            link, _ = listening.accept()
            if not os.fork():
                listening.close()
                events.close()
                stand_by(link)
            link.close()


def stand_by(link: socket.socket) -> None:
    """Let a supervisor work with the files that come over `link`; tell its status there, kill it if nobody waits."""
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    numbers, files, _, _ = socket.recv_fds(link, MOST_FILES, MOST_FILES)
    process = os.fork()
    if not process:
        os.setsid()
        waiting = link.detach()
        for found in files:  # out of the way of the numbers that they are to have
            os.dup2(found, found + 256)
            os.close(found)
        os.close(waiting)
        for number, found in zip(numbers, files, strict=True):
            os.dup2(found + 256, number)
            os.close(found + 256)
        supervisor.main()
    for number in files:
        os.close(number)
    with selectors.DefaultSelector() as events:
        events.register(link, selectors.EVENT_READ)
        events.register(os.pidfd_open(process), selectors.EVENT_READ)
        if any(key.fileobj is link for key, _ in events.select()):
            os.kill(process, signal.SIGKILL)
            os._exit(0)
    status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    with suppress(BrokenPipeError):
        link.sendall(bytes([status & 0xFF]))
    os._exit(0)


if __name__ == "__main__":
    serve(sys.argv[1])
