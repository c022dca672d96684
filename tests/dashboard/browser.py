"""A dashboard in a process of its own, and a real browser to look at it with."""

import json
import os
import re
import shutil
import signal
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect, sync_playwright

from tests.command_line import LABCTL

NAMES = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome")
LINK = "/?token="
WIDE, NARROW = (1280, 900), (390, 844)
PATIENCE_MS = 120_000
SOON_MS = 20_000
FLAGS = [
    "--no-sandbox",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-dev-shm-usage",
    "--disable-gpu",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
]


def chromium() -> str | None:
    """Where Chromium is installed; None if it is not."""
    return next((found for name in NAMES if (found := shutil.which(name)) is not None), None)


needs_chromium = pytest.mark.skipif(chromium() is None, reason="Chromium is not installed")


@dataclass(frozen=True)
class Dashboard:
    """A dashboard that is served: its address, its process, and links: one at a time, each when the last was used."""

    base: str
    process: int
    links: Iterator[str]

    @property
    def port(self) -> int:
        """TCP port."""
        return int(self.base.rpartition(":")[2])


@contextmanager
def dashboard(
    runs: Path | str, opening: Mapping[str, str] | None = None, labctl: Sequence[str] = LABCTL
) -> Iterator[Dashboard]:
    """`labctl dashboard` for the runs in a folder or at a URL; `opening` tells which browser it opens, if any."""
    no_open = ["--no-open"] if opening is None else []
    named = runs.name if isinstance(runs, Path) else runs
    command = [*labctl, "dashboard", named, "--port", "0", "--json", *no_open]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=runs.parent if isinstance(runs, Path) else None,
        env=os.environ | (opening or {}),
    ) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        first = json.loads(process.stdout.readline())["url"]
        later = (line.split()[-1] for line in process.stderr if LINK in line)
        try:
            yield Dashboard(first.partition("/?")[0], process.pid, chain([first], later))
        finally:
            process.send_signal(signal.SIGINT)
        assert process.wait(30) == 0


@contextmanager
def browser() -> Iterator[Browser]:
    """Chromium, without a window and without a network."""
    expect.set_options(timeout=PATIENCE_MS)
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=chromium(), args=FLAGS, timeout=PATIENCE_MS)
        yield started
        started.close()


def opened(browser: Browser, size: tuple[int, int] = WIDE, *, dark: bool = False) -> Page:
    """A page of a user of its own, who waits as long as a busy machine takes."""
    context = browser.new_context(
        viewport={"width": size[0], "height": size[1]}, color_scheme="dark" if dark else "light"
    )
    context.set_default_timeout(PATIENCE_MS)
    return context.new_page()


def enter(page: Page, served: Dashboard) -> str:
    """Let a page in by the next link; the address of the list of runs, which all others begin with."""
    page.goto(next(served.links))
    page.wait_for_url(re.compile(f"^{re.escape(served.base)}/[^/?]+/$"))
    return page.url


@contextmanager
def let_in(browser: Browser, served: Dashboard) -> Iterator[Page]:
    """The list of runs, of a user of its own; nothing is fetched from anywhere else, and no script fails."""
    page = opened(browser)
    wrong: list[str] = []
    page.on(
        "request", lambda request: None if request.url.startswith((served.base, "data:")) else wrong.append(request.url)
    )
    page.on("pageerror", lambda error: wrong.append(str(error)))
    enter(page, served)
    yield page
    page.context.close()
    assert wrong == []


def connected(page: Page) -> None:
    """Wait until the page has its connection: before that it may load itself anew, and forget what was typed."""
    page.wait_for_function("window.did_handshake === true")


def says(page: Page, region: str, pattern: str) -> None:
    """Wait until a part of the page has words that a regular expression finds."""
    expect(page.locator(region)).to_contain_text(re.compile(pattern))


def start_long_run(page: Page, station: Path, cost: str, **more: str) -> None:
    """Start a run by the form, with more settings, where what it will cost reads like `cost`; its page is then open."""
    page.get_by_role("link", name="Start a run").click()
    page.wait_for_url("**/start")
    connected(page)
    page.get_by_label("Station file").fill(str(station))
    for name, value in {"images": "1000", "window": "0.8 ns", **more}.items():
        page.get_by_label(name, exact=True).fill(value)
    says(page, ".form .cost", cost)
    page.get_by_role("switch").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.wait_for_url("**/run/*")
    connected(page)


def narrow(page: Page) -> None:
    """Make the window as wide as a telephone; the page must come to fit into it."""
    page.set_viewport_size({"width": NARROW[0], "height": NARROW[1]})
    fits(page)


def fits(page: Page) -> None:
    """Wait until the page is no wider than its window, which it is at once but for what is still being drawn."""
    page.wait_for_function("document.documentElement.scrollWidth <= window.innerWidth", timeout=SOON_MS)
