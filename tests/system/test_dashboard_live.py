"""The live view in a real browser: started, watched, its light switched off and on and set, and ended."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs the extra `dashboard`")
pytest.importorskip("playwright", reason="a browser is driven by playwright")

from PIL import Image
from playwright.sync_api import Browser, Page, expect

from labctl.runs.format.layout import RunPaths
from labctl.runs.live.events import EventReader
from labctl.runs.live.sight import LIVE
from labctl.runs.notes import read_notes
from tests.command_line import LABCTL
from tests.dashboard.browser import (
    Dashboard,
    connected,
    dashboard,
    let_in,
    narrow,
    needs_chromium,
    says,
    start_long_run,
)

pytestmark = needs_chromium
PORTS = 4


@pytest.fixture
def shown(tmp_path: Path) -> Iterator[Dashboard]:
    folder = tmp_path / "runs"
    folder.mkdir()
    with dashboard(folder) as found:
        yield found


@pytest.fixture
def page(window: Browser, shown: Dashboard) -> Iterator[Page]:
    """The page of the live view."""
    with let_in(window, shown) as page:
        page.goto(f"{page.url}live")
        connected(page)
        yield page


def start(page: Page, station: Path) -> None:
    page.get_by_label("Station file").fill(str(station))
    page.get_by_role("switch").click()
    page.get_by_role("button", name="Start", exact=True).click()
    says(page, ".emission-region", "LASER ON")
    says(page, ".levels-region", "trace [1-9]")
    connected(page)


def test_what_nobody_allows_is_refused_and_told(page: Page, unarmed: Path, emitting: Callable[[], bool]) -> None:
    page.get_by_label("Station file").fill(str(unarmed))
    page.get_by_role("button", name="Start", exact=True).click()
    says(page, ".form .message", "the laser is not armed, no light is switched on")
    assert not emitting()


def test_it_is_started_watched_and_ended(page: Page, unarmed: Path, emitting: Callable[[], bool]) -> None:
    start(page, unarmed)
    assert emitting()
    (view,) = (unarmed.parent / "runs" / LIVE).iterdir()
    [begun, *_] = EventReader(view / "events.jsonl").read()
    assert begun.fields["unwatched_s"] == 600
    expect(page.get_by_role("meter")).to_have_count(PORTS)
    expect(page.locator(".signals-region figure")).to_have_count(PORTS)
    says(page, ".repeats-region", r"port 5\s*\d+\.\d dB")
    says(page, ".codes-region", "no sample is at an end of the range")
    expect(page.locator(".spectrum-region polyline")).to_have_count(PORTS)
    expect(page.locator(".course-region polyline")).to_have_count(2 * PORTS)
    scale = page.locator(".signals-region .y").first
    fixed = scale.inner_text()
    page.get_by_role("button", name="Tone", exact=True).click()
    expect(page.locator(".tone")).to_have_attribute("aria-pressed", "true")
    own = page.get_by_role("switch", name="each on a scale of its own")
    own.click()
    expect(own).to_be_checked()
    expect(scale).not_to_have_text(fixed)
    own.click()
    expect(own).not_to_be_checked()
    expect(scale).to_have_text(fixed, use_inner_text=True)
    narrow(page)
    page.get_by_role("button", name="End").click()
    says(page, ".emission-region", "LASER OFF")
    assert not emitting()


@pytest.mark.skipif(sys.platform == "win32", reason="needs a shell; there every virtual environment does so")
def test_its_page_is_found_where_another_process_starts_python(
    window: Browser, tmp_path: Path, unarmed: Path, emitting: Callable[[], bool]
) -> None:
    python = tmp_path / "python"
    python.write_text(f'#!/bin/sh\n"{sys.executable}" "$@"\nexit $?\n', encoding="utf-8")
    python.chmod(0o700)
    (tmp_path / "runs").mkdir()
    in_an_environment = (sys.executable, "-c", f"import sys; sys.executable = {str(python)!r}; {LABCTL[-1]}")
    with dashboard(tmp_path / "runs", labctl=in_an_environment) as shown, let_in(window, shown) as page:
        page.goto(f"{page.url}live")
        connected(page)
        start(page, unarmed)
        page.get_by_role("button", name="End").click()
        says(page, ".emission-region", "LASER OFF")
    assert not emitting()


def test_a_view_that_no_page_shows_any_more_ends_dark_and_says_why(
    page: Page, served: tuple[dict[str, Any], Path], tmp_path: Path, emitting: Callable[[], bool]
) -> None:
    command = [*LABCTL, "live", f"--station={served[1]}", f"--runs={tmp_path / 'runs'}", "--unwatched=5 s"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as view:
        expect(page.get_by_label("Station file")).to_be_visible()
        while not list((tmp_path / "runs" / LIVE).glob("*/sight")):
            assert view.poll() is None
            page.wait_for_timeout(100)
        page.reload()
        says(page, ".levels-region", r"trace \d{3}")
        assert emitting(), "a hundred looks, ten a second at most, are longer than it waits"
        page.get_by_role("link", name="labctl").click()
        assert view.wait(60) == 0
    assert not emitting()
    page.get_by_role("link", name="Live").click()
    says(page, ".before", "The view before: stopped: nobody has looked for 5 s")


@contextmanager
def viewing(runs: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """A live view of a simulated bench, killed at the end if it is still there."""
    with subprocess.Popen([*LABCTL, "live", f"--runs={runs}"], stdout=subprocess.DEVNULL) as view:
        try:
            yield view
        finally:
            view.kill()


def test_the_view_that_is_going_on_is_shown_and_the_next_one_when_it_has_ended(page: Page, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    odd = runs / os.fsdecode(b"not UTF-8 \xff")
    odd.mkdir()
    (odd / "manifest.json").touch()
    with viewing(runs) as view:
        while not list((runs / LIVE).glob("*/sight")):
            assert view.poll() is None
            page.wait_for_timeout(100)
        page.wait_for_timeout(1000)  # names go to the second, and the next one is to be the last
        subprocess.run([*LABCTL, "live", f"--runs={runs}", "--for=0.5 s"], stdout=subprocess.DEVNULL, check=True)
        page.reload()
        connected(page)
        says(page, ".emission-region", "LASER ON")
        says(page, ".levels-region", "trace [1-9]")
        page.get_by_role("button", name="End").click()
        assert view.wait(60) == 0
    says(page, ".emission-region", "LASER OFF")
    says(page, ".old-region", "the view has ended: nothing is measured, what is shown was seen before")
    expect(page.get_by_role("button", name="End")).to_be_hidden()
    expect(page.get_by_role("button", name="Laser off")).to_be_hidden()
    with viewing(runs) as view:
        says(page, ".emission-region", "LASER ON")
        expect(page.locator(".old-region")).to_be_empty()
        page.get_by_role("button", name="End").click()
        assert view.wait(60) == 0


def test_light_is_off_at_once_and_on_behind_the_switch(page: Page, unarmed: Path, emitting: Callable[[], bool]) -> None:
    start(page, unarmed)
    page.get_by_role("button", name="Laser off").click()
    says(page, ".emission-region", "LASER OFF")
    assert not emitting()
    says(page, ".old-region", "the laser is off: nothing is measured, what is shown was seen before")
    page.get_by_role("button", name="Tone", exact=True).click()
    page.wait_for_function("labctlTone.sound.volume.gain.value === 0")
    on = page.get_by_role("button", name="Laser on")
    expect(on).to_be_disabled()
    page.get_by_role("switch", name="light may be switched on").click()
    on.click()
    says(page, ".emission-region", "LASER ON")
    expect(page.locator(".old-region")).to_be_empty()
    page.wait_for_function("labctlTone.sound.volume.gain.value > 0")
    page.get_by_role("textbox", name="Power").fill("5 mW")
    page.get_by_role("button", name="Set").click()
    says(page, ".emission-region", " 5 mW")
    page.get_by_role("textbox", name="Power").fill("500 mW")
    page.get_by_role("button", name="Set").click()
    says(page, ".log-region", r"not set: .* laser\.power = 500 mW exceeds limits")
    page.get_by_role("switch", name="drive").click()
    says(page, ".bench-region", "the drive is off")
    says(page, ".old-region", "the drive is off: nothing is measured")
    page.get_by_role("switch", name="drive").click()
    says(page, ".bench-region", "the drive plays")
    page.get_by_role("button", name="End").click()
    says(page, ".emission-region", "LASER OFF")
    assert not emitting()


def test_a_run_that_measures_has_the_same_panels(page: Page, unarmed: Path, emitting: Callable[[], bool]) -> None:
    page.get_by_role("link", name="labctl").click()
    start_long_run(page, unarmed, "on a real bench", reference_every="5")
    says(page, ".progress-region", r"[1-9]\d* of \d+ records")
    page.get_by_text("Signals: levels").click()
    says(page, ".levels-region", r"[1-9]\d* shots")
    says(page, ".repeats-region", r"port 5\s*\d+\.\d dB")
    expect(page.locator(".signals-region figure")).to_have_count(PORTS)
    expect(page.locator(".course-region polyline")).to_have_count(2 * PORTS)
    before = page.locator(".levels-region .caption").inner_text()
    expect(page.locator(".levels-region .caption")).not_to_have_text(before)
    page.get_by_label("Note with the picture").fill("fibre touched")
    page.get_by_role("button", name="Keep a picture").click()
    says(page, ".signals .message", "kept in the notes of")
    run = RunPaths(unarmed.parent / "runs" / page.url.rpartition("/")[2])
    (note,) = read_notes(run).notes
    assert note.text == "fibre touched"
    with Image.open(run.pictures / note.picture) as picture:
        assert picture.size[0] > 600
    narrow(page)
    page.get_by_role("button", name="Stop", exact=True).click()
    says(page, ".progress-region", "stopped")
    assert not emitting()
