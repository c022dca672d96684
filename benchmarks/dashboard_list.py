"""How long the dashboard's page takes to list and to search ten thousand runs, in a browser.

Seconds until the rows are drawn: of the first page ever, which makes the catalogue, of the next ones, and after words
were typed. The reference, in the same run: the same page of a folder that holds no run.
"""

import statistics
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from playwright.sync_api import Browser, Page

from benchmarks.catalogue import RUNS, generate
from benchmarks.rows import REPETITIONS, Goal, Row
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from protocols.image_readout import ImageReadout
from tests.dashboard.browser import browser, chromium, connected, dashboard, enter, opened

WORDS = {"few": "seed >= 9990 and protocol = image-readout", "words": "mnist 9990", "many": "images >= 1"}
COUNTS = {"few": 10, "words": 1, "many": RUNS}


def seconds_of(page: Page, address: str) -> float:
    """Of a page until its list stands there."""
    began = time.perf_counter()
    page.goto(address)
    page.wait_for_selector(".all-region .runs, .all-region .nothing")
    return time.perf_counter() - began


def measured(window: Browser, folder: Path) -> dict[str, float]:
    """Seconds of a folder's pages: the first, the median of the next, and of searches as they are typed."""
    with dashboard(folder) as served:
        page = opened(window)
        began = time.perf_counter()
        base = enter(page, served)
        page.wait_for_selector(".all-region .runs, .all-region .nothing")
        found = {"first_s": time.perf_counter() - began}
        found["next_s"] = statistics.median(seconds_of(page, base) for _ in range(REPETITIONS))
        if page.locator("a.run").count():
            connected(page)
            for name, words in WORDS.items():
                began = time.perf_counter()
                page.get_by_label("Search").fill(words)
                page.wait_for_function(f"document.querySelector('.count').innerText.endsWith('of {COUNTS[name]}')")
                found[f"{name}_s"] = time.perf_counter() - began
        page.context.close()
    return found


def rows() -> Iterator[Row]:
    """The first page, the next one, and searches."""
    if chromium() is None:
        raise SystemExit("Chromium is not installed: nothing measured")
    with tempfile.TemporaryDirectory() as place, browser() as window:
        template, folder, empty = (Path(place) / name for name in ("run", "runs", "empty"))
        acquire(Acquisition(ImageReadout(images=4), SIMULATED_STATION, template))
        generate(folder, template)
        empty.mkdir()
        found, reference = measured(window, folder), measured(window, empty)
    against = "the same page of no runs"
    yield Row(f"page of {RUNS} runs, the first", found["first_s"], "s", against=against, reference=reference["first_s"])
    for name, what in (("next", "the next"), *((word, f"searched for {word}") for word in WORDS)):
        goal = Goal(most=1.0, of="figure")
        yield Row(f"page of {RUNS} runs, {what}", found[f"{name}_s"], "s", None, against, reference["next_s"], goal)
