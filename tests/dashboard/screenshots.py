"""The pictures of docs/how-to/watch-a-run.md, taken of the dashboard itself.

    python -m tests.dashboard.screenshots [FOLDER]

Two small runs are measured on the simulated bench, a long one is started, and the pages are shown to Chromium while it
measures; the pictures go into FOLDER, docs/ unless told otherwise.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page

from tests.dashboard.browser import LABCTL, NARROW, browser, chromium, dashboard, opened

WINDOW = "window=1 ns"
FINISHED = {
    "20261120T090000Z-image-readout-5b1f60aa": ("images=300", WINDOW),
    "20261120T093000Z-image-readout-c2d07e13": ("images=300", WINDOW, "seed=2"),
}
RUNNING = "20261121T091500Z-image-readout-1a2b3c4d"


def take(folder: Path, executable: str) -> None:
    """Take all pictures."""
    with tempfile.TemporaryDirectory() as place:
        runs = Path(place) / "runs"
        runs.mkdir()
        for name, settings in FINISHED.items():
            subprocess.run(_command(runs / name, settings), check=True, stdout=subprocess.DEVNULL)
        running = subprocess.Popen(_command(runs / RUNNING, ("images=4000", WINDOW, "wavelengths=1550 nm, 1551 nm")))
        try:
            with dashboard(runs) as served, browser(executable) as started:
                page = opened(started)
                page.goto(served.address)
                page.wait_for_selector(".live-region .emission.on")
                page.screenshot(path=folder / "dashboard-list.png", full_page=True)
                page.goto(f"{served.base}/run/{RUNNING}")
                _settle(page)
                page.screenshot(path=folder / "dashboard-run.png", full_page=True)
                _compare(page, served.base)
                page.screenshot(path=folder / "dashboard-compare.png", full_page=True)
                phone = opened(started, NARROW, dark=True)
                phone.goto(served.address)
                phone.wait_for_selector(".live-region .emission.on")
                phone.goto(f"{served.base}/run/{RUNNING}")
                _settle(phone)
                phone.screenshot(path=folder / "dashboard-phone.png", full_page=True)
        finally:
            running.terminate()
            running.wait()


def _settle(page: Page) -> None:
    for wanted in (".emission.on", ".ports-region figure", ".picture-region svg", ".accuracy-region svg"):
        page.wait_for_selector(wanted)


def _compare(page: Page, base: str) -> None:
    one, other = FINISHED
    page.goto(f"{base}/compare/{one}/{other}")
    page.wait_for_selector(".ports-region polyline.b")
    page.wait_for_selector(".accuracy-region polyline.b")


def _command(directory: Path, settings: tuple[str, ...]) -> list[str]:
    words = [word for setting in settings for word in ("--set", setting)]
    return [*LABCTL, "run", "image-readout", *words, "--out", str(directory)]


if __name__ == "__main__":
    found = chromium()
    if found is None:
        sys.exit("Chromium is not installed: no pictures are taken")
    take(Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs"), found)
