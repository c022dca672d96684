"""What it costs an acquisition that somebody watches it: its rate with the dashboard open in a browser, and without.

    python benchmarks/dashboard.py [rounds] [seconds]

One run of `labctl run` in a process of its own, whose events have its rate. While it measures, stretches with the page
of this run open in Chromium, its signals unfolded, and stretches without a dashboard follow each other as closed, open,
open, closed, so that a slow drift of the machine counts for both alike; 3 rounds of 10 s stretches unless an argument
says otherwise. The reference is the same run in the same minutes. What it takes to start dashboard and browser is not
counted. Asked for: at least 0.95, with the signals drawn five times a second.
"""

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime
from pathlib import Path

import numpy as np

from labctl.runs.live.events import EventReader
from tests.dashboard.browser import LABCTL, browser, chromium, dashboard, enter, opened

REQUIRED = 0.95
SETTINGS = ("images=4000", "ports=2-5", "wavelengths=" + ", ".join(f"{1540 + n} nm" for n in range(20)))
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


def stretch(directory: Path, seconds: float, *, watched: bool) -> tuple[float, float]:
    """Begin and end of some seconds in which the run is watched, or is not."""
    with ExitStack() as stack:
        if watched:
            served = stack.enter_context(dashboard(directory.parent))
            page = opened(stack.enter_context(browser()))
            page.goto(f"{enter(page, served)}run/{directory.name}")
            page.wait_for_selector(".ports-region figure")
            page.get_by_text("Signals: levels").click()
            page.wait_for_selector(".levels-region .level")
            page.evaluate(COUNT)
        time.sleep(SETTLE_S)
        begin = time.time()
        before = page.evaluate("window.drawn") if watched else 0
        time.sleep(seconds)
        end = time.time()
        if watched:
            print(f"signals drawn {(page.evaluate('window.drawn') - before) / (end - begin):.1f} times a second")  # noqa: T201
        return begin, end


def main(rounds: int, seconds: float) -> int:
    """Measure and print; 1 if watching costs more than it may."""
    if chromium() is None:
        print("Chromium is not installed: nothing measured")  # noqa: T201
        return 1
    with tempfile.TemporaryDirectory() as folder:
        directory = Path(folder) / "run"
        with running(directory) as process:
            rate = Rate(directory)
            while not rate.read():
                require_running(process)
                time.sleep(0.2)
            order = [False, True, True, False] * rounds
            spans = [(watched, *stretch(directory, seconds, watched=watched)) for watched in order]
            time.sleep(SETTLE_S)
            rate.read()
            require_running(process)
    rates = {kind: [rate.between(b, e) for watched, b, e in spans if watched is kind] for kind in (False, True)}
    for kind, name in ((False, "closed"), (True, "open")):
        found = np.array(rates[kind])
        print(f"{name:6} {found.mean():7.1f} records/s  ({', '.join(f'{one:.0f}' for one in found)})")  # noqa: T201
    ratio = float(np.mean(rates[True]) / np.mean(rates[False]))
    print(f"open / closed = {ratio:.3f}, at least {REQUIRED} asked for")  # noqa: T201
    return 0 if ratio >= REQUIRED else 1


if __name__ == "__main__":
    given = [float(word) for word in sys.argv[1:]]
    sys.exit(main(int(given[0]) if given else 3, given[1] if len(given) > 1 else 10.0))
