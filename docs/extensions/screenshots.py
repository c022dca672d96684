"""Takes the pictures of the dashboard with Chromium whenever the documents are built, and says so where it cannot.

Two small runs are measured on the simulated bench, a long one is started, and its pages are shown to Chromium while it
measures. A page shows what was taken as any picture, `![what it shows](../made/dashboard-run.png)`; without Chromium
the place of the picture says that it is missing and why.
"""

import json
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, Page, sync_playwright
from sphinx.application import Sphinx

LABCTL = (sys.executable, "-m", "labctl")
BROWSERS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
FLAGS = ["--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu", "--disable-background-networking"]
WIDE, NARROW = (1280, 900), (390, 844)
PATIENCE_MS = 120_000

WINDOW = "window=1 ns"
FINISHED = {
    "20261120T090000Z-image-readout-5b1f60aa": ("images=300", WINDOW),
    "20261120T093000Z-image-readout-c2d07e13": ("images=300", WINDOW, "seed=2"),
}
RUNNING = "20261121T091500Z-image-readout-1a2b3c4d"
LONG = ("images=4000", WINDOW, "wavelengths=1550 nm, 1551 nm, 1552 nm, 1553 nm")

PICTURE = re.compile(r"!\[([^]]*)\]\(\.\./made/(dashboard-\w+\.png)\)")
MISSING = "*{} (this picture is missing, since no Chromium was found where these pages were built)*"


def take(app: Sphinx) -> None:
    """Take all pictures, with the HTML."""
    made = Path(app.srcdir) / "made"
    if app.builder.name != "html":
        return
    executable = next(filter(None, map(shutil.which, BROWSERS)), None)
    if executable is None:
        print("no Chromium: the pages are built without the pictures of the dashboard, and say so", file=sys.stderr)
        return
    with tempfile.TemporaryDirectory() as folder, _chromium(executable) as browser:
        unheard = {"cwd": folder, "stdout": subprocess.DEVNULL}
        for run in [subprocess.Popen(_run(*finished), **unheard) for finished in FINISHED.items()]:
            if run.wait():
                raise subprocess.CalledProcessError(run.returncode, run.args)
        with (
            _ended(subprocess.Popen(_run(RUNNING, LONG), **unheard, stderr=subprocess.DEVNULL)),
            _served(folder) as link,
        ):
            _photograph(browser, link, made)


def say_what_is_missing(app: Sphinx, _page: str, source: list[str]) -> None:
    """In a page, words in place of every picture that was not taken."""
    made = Path(app.srcdir) / "made"

    def shown(picture: re.Match[str]) -> str:
        return picture[0] if (made / picture[2]).exists() else MISSING.format(picture[1])

    source[0] = PICTURE.sub(shown, source[0])


def _photograph(browser: Browser, link: str, folder: Path) -> None:
    page = _opened(browser, WIDE, "light")
    page.goto(link)
    _wait_for(page, ".live-region .emission.on")
    base, cookies = page.url, page.context.cookies()
    page.screenshot(path=folder / "dashboard-list.png", full_page=True)
    page.goto(f"{base}run/{RUNNING}")
    _wait_for(page, ".emission.on", ".ports-region figure", ".picture-region svg", ".accuracy-region svg")
    page.screenshot(path=folder / "dashboard-run.png", full_page=True)
    phone = _opened(browser, NARROW, "dark")
    phone.context.add_cookies(cookies)
    phone.goto(f"{base}run/{RUNNING}")
    _wait_for(phone, ".emission.on", ".ports-region figure", ".picture-region svg", ".accuracy-region svg")
    phone.screenshot(path=folder / "dashboard-phone.png", full_page=True)
    page.goto("{}compare/{}/{}".format(base, *FINISHED))
    _wait_for(page, ".ports-region polyline.b", ".accuracy-region polyline.b")
    page.screenshot(path=folder / "dashboard-compare.png", full_page=True)


def _opened(browser: Browser, size: tuple[int, int], colours: str) -> Page:
    context = browser.new_context(viewport={"width": size[0], "height": size[1]}, color_scheme=colours)
    context.set_default_timeout(PATIENCE_MS)
    return context.new_page()


def _wait_for(page: Page, *parts: str) -> None:
    for part in parts:
        page.wait_for_selector(part)


@contextmanager
def _chromium(executable: str) -> Iterator[Browser]:
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS, timeout=PATIENCE_MS)
        yield browser
        browser.close()


@contextmanager
def _served(folder: str) -> Iterator[str]:
    command = [*LABCTL, "dashboard", "--port", "0", "--no-open", "--json"]
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.DEVNULL}  # where the next link goes
    with _ended(subprocess.Popen(command, cwd=folder, text=True, **streams)) as process:
        yield json.loads(process.stdout.readline())["url"]


@contextmanager
def _ended(process: subprocess.Popen) -> Iterator[subprocess.Popen]:
    with process:
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)


def _run(name: str, settings: tuple[str, ...]) -> list[str]:
    chosen = [word for setting in settings for word in ("--set", setting)]
    return [*LABCTL, "run", "image-readout", *chosen, "--out", f"runs/{name}"]


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.connect("builder-inited", take, priority=600)  # `figures` empties the folder first
    app.connect("source-read", say_what_is_missing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
