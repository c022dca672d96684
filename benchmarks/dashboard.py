"""What it costs an acquisition that somebody watches it: its rate with the dashboard open in a browser, and without.

One run of `labctl run` in a process of its own, whose events have its rate. While it measures, stretches with the page
of this run open in Chromium, its signals unfolded, and stretches without a dashboard follow each other as closed, open,
open, closed, so that a slow drift of the machine counts for both alike. The reference is the same run in the same
minutes. What it costs to start dashboard and browser, until the page has its first accuracy, is a row of its own.
"""

import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from benchmarks.rows import Goal, Row
from labctl.runs.live.events import EventReader
from tests.command_line import LABCTL
from tests.dashboard.browser import browser, chromium, dashboard, enter, opened

SETTINGS = ("images=4000", "ports=2-5", "wavelengths=" + ", ".join(f"{1540 + n / 2} nm" for n in range(40)))
"""A pass on four ports, again at every wavelength: as long as is needed, and each pass as fast as the one before."""
SETTLE_S = 3.0
COUNT = """() => {
  window.drawn = 0;
  new MutationObserver(() => { window.drawn += 1; })
    .observe(document.querySelector(".levels-region"), {childList: true, subtree: true, characterData: true});
}"""
"""Count how often the levels are drawn anew."""


class Rate:
    """How many records a run has measured at which time, by its events."""

    def __init__(self, directory: Path) -> None:
        """Of the run in `directory`."""
        self._reader = EventReader(directory / "events.jsonl")
        self._at: list[float] = []
        self._done: list[float] = []

    def read(self) -> int:
        """Take in what came; how many records there are so far."""
        while events := self._reader.read():
            for event in events:
                if event.name == "progress":
                    self._at.append(datetime.fromisoformat(event.time).timestamp())
                    self._done.append(float(event.fields["done"]))
        return int(self._done[-1]) if self._done else 0

    def between(self, begin: float, end: float) -> float:
        """Records per second from one time to another, s since 1970."""
        done = np.interp([begin, end], self._at, self._done)
        return float(done[1] - done[0]) / (end - begin)


@contextmanager
def running(directory: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A long run on a simulated bench."""
    settings = [word for setting in SETTINGS for word in ("--set", setting)]
    command = [*LABCTL, "run", "image-readout", *settings, "--out", str(directory)]
    with subprocess.Popen(command) as process:  # noqa: S603
        yield process
        process.terminate()


def require_running(process: subprocess.Popen[bytes]) -> None:
    """End the benchmark if the run has ended."""
    if process.poll() is not None:
        sys.exit("the run ended before the measurement did: give it more images")


class Stretch(NamedTuple):
    """Some seconds of the run: whether it was watched, begin and end (s since 1970), drawings a second.

    What was started before `begin` was started at `starting`.
    """

    watched: bool
    starting: float
    begin: float
    end: float
    drawn_per_s: float

    @classmethod
    def of(cls, directory: Path, seconds: float, *, watched: bool) -> Self:
        """Let some seconds go by in which the run is watched, or is not."""
        with ExitStack() as stack:
            starting = time.time()
            if watched:
                served = stack.enter_context(dashboard(directory.parent))
                page = opened(stack.enter_context(browser()))
                page.goto(f"{enter(page, served)}run/{directory.name}")
                page.wait_for_selector(".ports-region figure")
                page.get_by_text("Signals: levels").click()
                page.wait_for_selector(".levels-region .level")
                page.wait_for_selector(".accuracy-region figure", timeout=60_000)
                page.evaluate(COUNT)
            time.sleep(SETTLE_S)
            begin = time.time()
            before = page.evaluate("window.drawn") if watched else 0
            time.sleep(seconds)
            end = time.time()
            drawn = page.evaluate("window.drawn") - before if watched else 0
            return cls(watched, starting, begin, end, drawn / (end - begin))


def rows(rounds: int = 5, seconds: float = 10.0) -> Iterator[Row]:
    """The rate with the dashboard open beside that without, and how often its signals are drawn."""
    if chromium() is None:
        raise SystemExit("Chromium is not installed: nothing measured")
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder) / "run"
        with running(directory) as process:
            rate = Rate(directory)
            while not rate.read():
                require_running(process)
                time.sleep(0.2)
            order = [False, True, True, False] * rounds
            stretches = [Stretch.of(directory, seconds, watched=watched) for watched in order]
            time.sleep(SETTLE_S)
            rate.read()
            require_running(process)
    watched, alone = (
        statistics.mean(rate.between(one.begin, one.end) for one in stretches if one.watched is kind)
        for kind in (True, False)
    )
    starting = statistics.mean(rate.between(one.starting, one.begin) for one in stretches if one.watched)
    yield Row("run while dashboard and browser start", starting, "records/s", None, "not watched", alone)
    yield Row("run watched on the dashboard", watched, "records/s", None, "not watched", alone, Goal(least=0.95))
    drawn = statistics.median(one.drawn_per_s for one in stretches if one.watched)
    yield Row("signals drawn meanwhile", drawn, "1/s", goal=Goal(least=5.0, of="figure"))
