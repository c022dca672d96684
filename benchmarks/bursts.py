"""Hardware-timed bursts on the simulated bench: how fast, where the time goes, and whether they see what one shot sees.

    python -m benchmarks bursts

References, all of the same run: as many bytes through a bare socket, the shards' bytes written and synced without
anything else, the DMD's 22,727 pictures a second, and a software-timed run of the same images.
"""

import os
import socket
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.rows import REPETITIONS, Goal, Row
from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.vialux_alp import VialuxAlp
from labctl.analysis.evaluation import validate
from labctl.analysis.splits import random_splits
from labctl.analysis.windows import WindowFeatures
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.engine import Outcome
from labctl.engine.session import Acquisition, acquire
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from labctl.runs.write.writer import RunWriter
from protocols.bursts import UPLOAD_BLOCK
from protocols.image_readout import ImageReadout
from sim_backends.world.receivers import ProcessorReceivers
from sim_backends.world.world import World

WINDOW_S = 0.4e-9
PICTURE_BYTES = 768 * 1024 // 8
IMAGES = 4000
"""The bundled digits, so that every machine measures the same."""
SPLITS = 10


class Spans:
    """When calls of some methods began and ended (s)."""

    def __init__(self, *watched: tuple[type, str]) -> None:
        """Watch methods, named by class and name, for the rest of the process."""
        self._spans: dict[str, list[tuple[float, float]]] = {name: [] for _, name in watched}
        for owner, name in watched:
            setattr(owner, name, self._timed(getattr(owner, name), name))

    def within(self, name: str, begin: float, end: float) -> list[tuple[float, float]]:
        """The calls of `name` that began in this time."""
        return [span for span in self._spans[name] if begin <= span[0] < end]

    def total(self, name: str, begin: float, end: float) -> float:
        """How long they took together (s)."""
        return sum(last - first for first, last in self.within(name, begin, end))

    def _timed(self, method: Callable[..., Any], name: str) -> Callable[..., Any]:
        @wraps(method)
        def timed(*arguments: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return method(*arguments, **named)
            finally:
                self._spans[name].append((began, time.perf_counter()))

        return timed


def bare_socket_s(blocks: int, size: int) -> float:
    """Time to send `blocks` of `size` bytes to a thread that receives them in one place and answers each."""
    listener = socket.create_server(("127.0.0.1", 0))

    def receive() -> None:
        connection, _ = listener.accept()
        room = bytearray(size)
        for _ in range(blocks):
            view = memoryview(room)
            while view:
                view = view[connection.recv_into(view) :]
            connection.sendall(b"0\n")

    threading.Thread(target=receive, daemon=True).start()
    block = bytes(size)
    with socket.create_connection(listener.getsockname()) as link:
        link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        began = time.perf_counter()
        for _ in range(blocks):
            link.sendall(block)
            link.recv(2)
        return time.perf_counter() - began


def bare_files_s(shards: Path, folder: Path) -> float:
    """Time to write and sync the bytes of `shards` once more, a file each."""
    images = [path.read_bytes() for path in sorted(shards.iterdir())]
    folder.mkdir()
    began = time.perf_counter()
    for number, image in enumerate(images):
        with (folder / str(number)).open("wb") as file:
            file.write(image)
            os.fsync(file.fileno())
    return time.perf_counter() - began


def run(protocol: ImageReadout, directory: Path) -> Outcome:
    """Carry out `protocol` on the simulated bench, over sockets."""
    return acquire(Acquisition(protocol, SIMULATED_STATION, directory)).outcome


@dataclass(frozen=True)
class Speed:
    """Of one run in bursts, and of its references; times in s."""

    shots_per_s: float
    upload_s: float
    bare_socket_s: float
    pictures_per_s: float
    physics_pictures_per_s: float
    storage_s: float
    bare_files_s: float


def speed(spans: Spans, folder: Path) -> Speed:
    """Of one run into `folder`."""
    begun = time.perf_counter()
    protocol = ImageReadout(images=IMAGES, window=WINDOW_S, timing="burst")
    outcome = run(protocol, folder / "burst")
    everything = (begun, np.inf)
    arms, stored = (spans.within(name, *everything) for name in ("arm_burst", "append"))
    # A pass begins with the first burst after ranging; it is on disk when its last burst is stored.
    bursts = len(arms) // 2
    passes = [(arms[pass_ * bursts][0], stored[(pass_ + 1) * bursts - 1][1]) for pass_ in range(2)]
    physics_s, storage_s = (
        sum(spans.total(name, *pass_) for name in names for pass_ in passes)
        for names in (("project", "record", "digitised"), ("append",))
    )
    pictures = 2 * outcome.shots
    return Speed(
        outcome.shots_per_second,
        spans.total("load", *everything),
        bare_socket_s(-(-outcome.shots // UPLOAD_BLOCK), UPLOAD_BLOCK * PICTURE_BYTES),
        pictures / sum(end - begin for begin, end in passes),
        pictures / physics_s,
        storage_s,
        bare_files_s(folder / "burst" / "shards", folder / "bare"),
    )


def accuracy(directory: Path) -> float:
    """Of the softmax readout on one run: mean over `SPLITS` splits."""
    with open_run(directory) as stored:
        records = read_records(stored)
    window = WindowFeatures(sample_interval_s=records.sample_interval_s, window_s=WINDOW_S)
    splits = random_splits(records.labels, records.groups, splits=SPLITS, test_size=0.1, seed=1)
    scores = validate(window.fit_transform(records.traces), records.labels, splits).scores
    return statistics.fmean(scores)


def rows() -> Iterator[Row]:
    """Of the same digits: five runs in bursts, and one of each timing for what a readout makes of them."""
    spans = Spans(
        (VialuxAlp, "load"),
        (Dpo72504dx, "arm_burst"),
        (World, "project"),
        (World, "record"),
        (ProcessorReceivers, "digitised"),
        (RunWriter, "append"),
    )
    with tempfile.TemporaryDirectory() as folder:
        found = []
        for number in range(REPETITIONS):
            (place := Path(folder) / str(number)).mkdir()
            found.append(speed(spans, place))

        def median(name: str) -> float:
            return float(statistics.median(getattr(one, name) for one in found))

        limit, mirrors = 1 / VialuxAlp.picture_period_s, Goal(least=1.0)
        what = f"{IMAGES} digits in bursts, two passes"
        yield Row(f"{what}: first light to last record", median("shots_per_s"), "shots/s")
        for name, of in (("pictures_per_s", "bursts to disk"), ("physics_pictures_per_s", "their physics")):
            yield Row(f"{what}: {of}", median(name), "pictures/s", None, "the DMD", limit, mirrors)
        for name, of, bare in (
            ("upload_s", "upload", "bare_socket_s"),
            ("storage_s", "storage, beside the next burst", "bare_files_s"),
        ):
            against = bare.removesuffix("_s").replace("_", " ")
            yield Row(f"{what}: {of}", median(name), "s", None, against, median(bare))
        software = ImageReadout(images=IMAGES, window=WINDOW_S)
        run(software, Path(folder) / "software")
        bursts, shots = accuracy(Path(folder) / "0" / "burst"), accuracy(Path(folder) / "software")
        yield Row(f"accuracy of {what}, ten splits", bursts, "", None, "software-timed", shots)
