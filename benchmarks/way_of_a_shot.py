"""How far a stranger reads to follow one software-timed shot: files that take part in it, and moves between them.

Every call of a function is traced from the end of the second shot to the end of the third, on four ports of the
simulated bench in this process. A file takes part if one of its functions is called. A move is a call of a function in
another file than that of the call before it, in the thread that measures; the moves of the simulated bench, which
stands for the hardware, are counted by themselves.
"""

import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from types import FrameType
from typing import Any

from benchmarks.rows import Goal, Row
from instruments.bench import Observer
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout

ROOT = Path(__file__).parents[1]
CLIENT, SIMULATOR = ("labctl", "protocols", "instruments"), ("sim_backends",)
PROTOCOL = ImageReadout(images=8, ports=(2, 3, 4, 5))
TRACED_SHOT = 3
"""The first shots find ranges, open files and fill caches; any later one takes the same way."""


@dataclass
class Way:
    """What was called, in order: the file of each call, by the thread it was in."""

    calls: dict[int, list[str]] = field(default_factory=dict)
    on: bool = False

    def hear(self, frame: FrameType, event: str, _argument: object) -> None:
        """Take down one call: what `sys.setprofile` calls."""
        if self.on and event == "call":
            name = frame.f_code.co_filename.removeprefix(f"{ROOT}/")
            if name.partition("/")[0] in CLIENT + SIMULATOR:
                self.calls.setdefault(threading.get_ident(), []).append(name)

    def files(self, packages: tuple[str, ...]) -> list[str]:
        """The files of some packages, each once, in the order in which they come."""
        found = dict.fromkeys(name for calls in self.calls.values() for name in calls)
        return [name for name in found if name.partition("/")[0] in packages]

    def moves(self, packages: tuple[str, ...]) -> int:
        """How often a call is in another file than the one before, in threads that begin in some packages."""
        threads = [calls for calls in self.calls.values() if calls[0].partition("/")[0] in packages]
        return sum(one != other for calls in threads for one, other in pairwise(calls))


def trace() -> Way:
    """Carry out a small run and follow one of its shots."""
    way = Way()
    threading.setprofile(way.hear)
    sys.setprofile(way.hear)

    class TracedShot(Observer):
        def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
            way.on = done == TRACED_SHOT - 1

    try:
        with tempfile.TemporaryDirectory() as folder:
            acquire(Acquisition(PROTOCOL, SIMULATED_STATION, Path(folder) / "run"), observer=TracedShot())
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return way


def rows() -> Iterator[Row]:
    """Files and moves of either side."""
    way = trace()
    for side, packages, most in (("client", CLIENT, 12), ("simulation", SIMULATOR, 17)):
        yield Row(
            f"files of the {side} that a shot goes through",
            len(way.files(packages)),
            "files",
            goal=Goal(most=most, of="figure"),
        )
        yield Row(f"moves between files of the {side}", way.moves(packages), "moves")
