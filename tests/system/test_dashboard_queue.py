"""Queue and sweeps in a real browser: added, moved, removed, carried out and watched while they grow."""

import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs the extra `dashboard`")
pytest.importorskip("playwright", reason="a browser is driven by playwright")

from playwright.sync_api import Browser, Page, expect

from labctl.runs.format.layout import RunPaths
from labctl.runs.index import run_row
from labctl.runs.queue import FILE, WAIT_S, Queue, State
from tests.dashboard.browser import connected, dashboard, fits, let_in, narrow, needs_chromium

pytestmark = needs_chromium


@pytest.fixture
def runs(tmp_path: Path) -> Path:
    folder = tmp_path / "runs"
    folder.mkdir()
    return folder


@pytest.fixture
def page(window: Browser, runs: Path) -> Iterator[Page]:
    with dashboard(runs) as served, let_in(window, served) as found:
        yield found


def add(page: Page, name: str, value: str, answer: str) -> None:
    """Add to the queue by the form, with one more setting."""
    page.get_by_label(name, exact=True).fill(value)
    page.get_by_role("button", name="Add to the queue").click()
    expect(page.locator(".form .message")).to_contain_text(answer)


def test_items_are_added_moved_removed_and_carried_out(page: Page, runs: Path) -> None:
    page.get_by_role("link", name="Start a run").click()
    page.wait_for_url("**/start")
    connected(page)
    page.get_by_label("ports").fill("2")
    page.get_by_label("window").fill("0.8 ns")
    add(page, "images", "many", "images = 'many'")
    page.get_by_label("images", exact=True).fill("4")
    for number, seed in enumerate((1, 2, 3), start=1):
        add(page, "seed", str(seed), f"number {number} of the queue")
    page.get_by_role("link", name="Queue").click()
    page.wait_for_url("**/queue")
    connected(page)
    items = page.locator(".item")
    expect(items).to_have_count(3)
    expect(items.first).to_contain_text("on a real bench")
    items.nth(2).get_by_role("button", name="earlier").click()
    expect(items.nth(1)).to_contain_text("seed=3")
    items.nth(2).get_by_role("button", name="remove").click()
    expect(items).to_have_count(2)
    page.get_by_role("button", name="Start", exact=True).click()
    expect(page.locator(".item.done")).to_have_count(2)
    page.locator(".item.done a").first.click()
    page.wait_for_url("**/run/queue-*")
    page.go_back()
    connected(page)
    fits(page)
    narrow(page)
    found = Queue(runs).items()
    assert [item.state for item in found] == [State.DONE] * 2
    assert all(run_row(RunPaths(item.directory)).complete for item in found)


def test_nobody_is_asked_to_stop_who_is_not_there(page: Page, runs: Path) -> None:
    page.get_by_role("link", name="Queue").click()
    page.wait_for_url("**/queue")
    connected(page)
    expect(page.locator(".queue")).to_have_text("nothing in the queue")
    page.get_by_role("button", name="Stop now").click()
    expect(page.locator(".message").first).to_have_text(
        f"{runs.name}: no process of this machine carries this queue out: nothing to stop"
    )
    Queue(runs).add(["run", "image-readout"], None, {}, "ada")
    expect(page.locator(".item.waiting")).to_have_count(1)
    page.get_by_role("button", name="Stop after this item").click()
    expect(page.locator(".message").first).to_contain_text("nothing to stop")
    assert Queue(runs).wishes == set()


def test_a_queue_that_another_process_holds_keeps_no_other_page(page: Page, runs: Path) -> None:
    base = page.url
    Queue(runs).add(["run", "image-readout"], None, {}, "ada")
    with closing(sqlite3.connect(runs / FILE)) as other:
        other.execute("BEGIN EXCLUSIVE")
        page.goto(f"{base}queue")
        connected(page)
        assert page.request.get(base, timeout=500 * WAIT_S).ok, "before the wait for the queue ends"
        expect(page.locator(".unread")).to_contain_text("database is locked")
    expect(page.locator(".item.waiting")).to_have_count(1)
    expect(page.locator(".unread")).to_be_empty()


def test_a_sweep_is_added_by_the_form_and_its_plot_grows(page: Page, runs: Path) -> None:
    base = page.url.rpartition("/")[0]
    page.goto(f"{base}/start")
    connected(page)
    page.get_by_label("images", exact=True).fill("60")
    page.get_by_label("ports").fill("2")
    page.get_by_label("Sweep over").fill("window=0.4 ns,0.8 ns")
    expect(page.locator(".form .cost")).to_contain_text("3 runs")
    page.get_by_role("button", name="Add to the queue").click()
    expect(page.locator(".form .message")).to_contain_text("of the queue")
    page.goto(f"{base}/queue")
    connected(page)
    page.get_by_role("button", name="Start", exact=True).click()
    expect(page.locator(".item.done", has_text="window=0.4 ns,0.8 ns")).to_have_count(1)
    page.goto(f"{base}/sweeps")
    connected(page)
    page.locator("a.sweep").click()
    page.wait_for_url("**/sweep/queue-*")
    connected(page)
    expect(page.locator(".not-real")).to_contain_text("SIMULATED")
    expect(page.locator(".sweep-plot-region")).to_contain_text("accuracy against window, 3 of 3 runs")
    expect(page.locator(".points-region")).to_contain_text(re.compile(r"0\.4 ns.*\d+\.\d % \[\d+\.\d, \d+\.\d\]"))
    fits(page)
    page.locator(".points-region a").first.click()
    page.wait_for_url("**/run/queue-*")
    connected(page)
    expect(page.locator(".progress-region")).to_contain_text("finished")
