"""Hardware-timed bursts on the simulated bench: how fast, where the time goes, and whether they see what one shot sees.

    python -m benchmarks.bursts [images]

10,000 images unless an argument says otherwise: of `mnist` where its files are (LABCTL_DATA), or the 4000 bundled
digits.
References, all of the same run: as many bytes through a bare socket, the shards' bytes written and synced without
anything else, the DMD's 22,727 pictures a second, and a software-timed run of the same images.
"""

import os
import socket
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any

import numpy as np

from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.vialux_alp import VialuxAlp
from labctl.analysis.evaluation import validate
from labctl.analysis.splits import random_splits
from labctl.analysis.windows import WindowFeatures
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.engine import Outcome
from labctl.engine.session import Acquisition, acquire
from labctl.errors import DatasetError
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from labctl.runs.write.writer import RunWriter
from protocols.bursts import UPLOAD_BLOCK
from protocols.image_readout import ImageReadout
from protocols.patterns import Patterns
from sim_backends.virtual.alp.instrument import VirtualAlp
from sim_backends.world.world import World

WINDOW_S = 0.4e-9
PICTURE_BYTES = 768 * 1024 // 8
COMPARED_IMAGES = 4000
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


def run_bursts(images: int, directory: Path) -> tuple[str, Outcome]:
    """Acquire `images` of MNIST in bursts, or of the bundled digits where MNIST is not; returns which."""
    protocol = ImageReadout(dataset="mnist", images=images, window=WINDOW_S, timing="burst")
    try:
        return protocol.dataset, run(protocol, directory)
    except DatasetError:
        bundled = protocol.model_copy(update={"dataset": "mnist-0-3", "images": min(images, 4000)})
        return bundled.dataset, run(bundled, directory)


def accuracy(directory: Path) -> tuple[float, float]:
    """Mean and standard deviation of the softmax readout's accuracy on one run over `SPLITS` splits."""
    with open_run(directory) as stored:
        records = read_records(stored)
    window = WindowFeatures(sample_interval_s=records.sample_interval_s, window_s=WINDOW_S)
    splits = random_splits(records.labels, records.groups, splits=SPLITS, test_size=0.1, seed=1)
    scores = validate(window.fit_transform(records.traces), records.labels, splits).scores
    return float(np.mean(scores)), float(np.std(scores, ddof=1))


def say(*columns: object) -> None:
    """Print one row."""
    name, *rest = columns
    sys.stdout.write(f"{name!s:44}" + "".join(f"{column!s:>22}" for column in rest) + "\n")


def measure_speed(images: int, folder: Path) -> None:
    """Acquire, and print where the time went beside the references."""
    spans = Spans(
        (VialuxAlp, "load"),
        (Patterns, "block"),
        (VirtualAlp, "put"),
        (Dpo72504dx, "arm_burst"),
        (VialuxAlp, "play"),
        (Dpo72504dx, "read_burst"),
        (World, "project"),
        (World, "record"),
        (RunWriter, "append"),
    )
    dataset, outcome = run_bursts(images, folder / "burst")
    everything = (0.0, np.inf)
    loads, arms, stored = (spans.within(name, *everything) for name in ("load", "arm_burst", "append"))
    upload_s = sum(end - begin for begin, end in loads)
    # A pass begins with the first burst after ranging; it is on disk when its last burst is stored.
    bursts = len(arms) // 2
    passes = [(arms[pass_ * bursts][0], stored[(pass_ + 1) * bursts - 1][1]) for pass_ in range(2)]
    acquired_s = sum(end - begin for begin, end in passes)

    def step(*names: str) -> float:
        return sum(spans.total(name, *pass_) for name in names for pass_ in passes)

    pictures, limit = 2 * outcome.shots, 1 / VialuxAlp.picture_period_s
    size = outcome.shots * PICTURE_BYTES
    bare_s = bare_socket_s(-(-outcome.shots // UPLOAD_BLOCK), UPLOAD_BLOCK * PICTURE_BYTES)
    physics_s = step("project", "record")
    files_s = bare_files_s(folder / "burst" / "shards", folder / "bare")

    say(f"{dataset}: {outcome.shots} shots in two passes", "s", "pictures/s", "reference")
    say("whole run, first light to last record", f"{outcome.seconds:.2f}", f"{outcome.shots_per_second:.0f} shots/s")
    say("upload, once", f"{upload_s:.2f}", f"{size / upload_s / 1e9:.2f} GB/s", f"bare socket {bare_s:.2f} s")
    say("  drawing the patterns", f"{spans.total('block', *everything):.2f}")
    say("  taking them into the DMD's memory", f"{spans.total('put', *everything):.2f}")
    say("bursts, both passes, to disk", f"{acquired_s:.2f}", f"{pictures / acquired_s:.0f}", f"DMD {limit:.0f}")
    say("  physics", f"{physics_s:.2f}", f"{pictures / physics_s:.0f}")
    say("  arming, playing, digitising, transfer", f"{step('arm_burst', 'play', 'read_burst') - physics_s:.2f}")
    say("  storage, beside the next burst", f"{step('append'):.2f}", "", f"bare files {files_s:.2f} s")
    say("tuning, ranging, data.h5", f"{outcome.seconds - upload_s - acquired_s:.2f}")
    say("left to the DMD's own rate", f"{acquired_s - pictures / limit:.2f}", f"x {limit * acquired_s / pictures:.1f}")


def compare_accuracy(folder: Path) -> None:
    """Print what a readout reaches on the same images in either timing."""
    for timing in ("software", "burst"):
        protocol = ImageReadout(images=COMPARED_IMAGES, window=WINDOW_S, timing=timing)
        outcome = run(protocol, folder / f"accuracy-{timing}")
        mean, deviation = accuracy(folder / f"accuracy-{timing}")
        found = f"{mean:.1%} +- {deviation:.1%}"
        say(f"accuracy, {COMPARED_IMAGES} digits 0-3, {timing}", found, f"{outcome.shots_per_second:.0f} shots/s")


def main() -> None:
    """Measure and print a table."""
    images = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    with tempfile.TemporaryDirectory() as folder:
        measure_speed(images, Path(folder))
        compare_accuracy(Path(folder))


if __name__ == "__main__":
    main()
