"""What a software-timed shot costs the program: processor time of the client, and bytes of commands.log.

The simulated bench is served by another process, so that its processor time, and the time that is charged to its
clock, are apart. The reference is what the bare messages of a shot cost the same processor: as many lines to a process
that does nothing but answer, as many pictures and curves, through bare sockets in turn with the runs. A shot is one on
two ports; start and end of the run are part of its mean.
"""

import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import IO, cast

from benchmarks.peer import HEADER, connected, peer
from benchmarks.rows import REPETITIONS, Goal, Row, timed
from labctl.bench.opening import Access
from labctl.bench.station import Station, read_station
from labctl.engine.session import Acquired, Acquisition, acquire
from protocols.image_readout import ImageReadout

PROTOCOL = ImageReadout(images=2000, ports=(2, 3))
LINES = (b"OUTPUT?\n", b"ALP:PROJHALT\n", b"ALP:PROJSTARTCONT 1\n", b"ACQuire:STATE RUN\n*OPC?\n")
"""Messages of a shot, with an answer each."""
CURVES, CURVE_BYTES = 2, 50
"""Its blocks."""
PICTURE_BYTES = 768 * 1024 // 8
SERVE = (sys.executable, "-m", "labctl", "sim", "serve", "--json", "--save-station")


def bare_shots_s(shots: int) -> float:
    """Processor time of as many messages as so many shots have, s a shot."""
    picture = bytes(PICTURE_BYTES)
    room = bytearray(1 << 12)
    with peer(bytes(CURVE_BYTES)) as address, connected(address) as link:

        def send() -> None:
            for _ in range(shots):
                for line in LINES:
                    link.sendall(line)
                    link.recv_into(room)
                link.sendall(b"ALP:SEQPUT 1,0,1," + HEADER % PICTURE_BYTES)
                link.sendall(picture)
                link.sendall(b"\n")
                link.recv_into(room)
                for _ in range(CURVES):
                    link.sendall(b"CURVe?\n")
                    link.recv_into(room)

        return timed(send).processor_s / shots


def run_s(station: Station, directory: Path) -> tuple[float, Acquired]:
    """Processor time of one run in this process, and how it went."""
    found: list[Acquired] = []
    asked = Acquisition(PROTOCOL, station, directory, access=Access(armed=True))
    taken = timed(lambda: found.append(acquire(asked)))
    return taken.processor_s, found[0]


def rows() -> Iterator[Row]:
    """Processor time and bytes of a shot."""
    runs, bare, sizes = [], [], []
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        served = folder / "served.toml"
        with subprocess.Popen([*SERVE, served], stdout=subprocess.PIPE) as server:  # noqa: S603
            try:
                cast(IO[bytes], server.stdout).readline()
                for number in range(REPETITIONS):
                    seconds, acquired = run_s(read_station(served), folder / str(number))
                    shots = acquired.outcome.shots
                    runs.append(seconds / shots)
                    bare.append(bare_shots_s(shots))
                    sizes.append((folder / str(number) / "commands.log").stat().st_size / shots)
            finally:
                server.terminate()
    yield Row(
        "processor time of the client, a software-timed shot on two ports",
        1e3 * statistics.median(runs),
        "ms",
        processor=1e3 * statistics.median(runs),
        against="its bare messages",
        reference=1e3 * statistics.median(bare),
        goal=Goal(most=1.0, of="figure"),
    )
    yield Row(
        "commands.log, a software-timed shot on two ports",
        statistics.median(sizes),
        "B",
        against="the digits of the CRC-32 of its three blocks",
        reference=3.0 * 8,
        goal=Goal(most=100.0, of="figure"),
    )
