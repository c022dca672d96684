"""The list of runs in a real browser: searched by what its rows read, with columns that are chosen, on any screen."""

import json
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs the extra `dashboard`")
pytest.importorskip("playwright", reason="a browser is driven by playwright")

from playwright.sync_api import Browser, Page, expect

from labctl.bench.station import Station
from labctl.engine.session import Acquisition, acquire
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import say_of
from protocols.image_readout import ImageReadout
from tests.dashboard.browser import connected, dashboard, fits, let_in, narrow, needs_chromium

RUNS = 230

pytestmark = needs_chromium


def described(run: Path, name: str, **changed: object) -> None:
    """A copy of a run whose manifest says something else of protocol, station and seeds."""
    copy = copytree(run, run.parent / name)
    manifest = json.loads((copy / "manifest.json").read_text("utf-8"))
    for path, value in changed.items():
        *tables, last = path.split("__")
        table = manifest
        for one in tables:
            table = table[one]
        table[last] = value
    (copy / "manifest.json").write_text(json.dumps(manifest), "utf-8")


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """More runs than are shown at once, of other seeds; one on a real bench, one on a mixed one."""
    folder = tmp_path_factory.mktemp("lab") / "runs"
    first = folder / "run-000"
    acquire(Acquisition(ImageReadout(images=4, window=0.8e-9, ports=(2,)), Station(), first))
    for number in range(1, RUNS - 2):
        described(first, f"run-{number:03d}", seeds__seed=1000 + number)
    manifest = json.loads((first / "manifest.json").read_text("utf-8"))
    real: dict[str, object] = {"seeds__twin_seed": None, "station__source": "bench.toml"}
    for role, instrument in manifest["instruments"].items():
        if instrument.get("identity"):
            real |= {f"station__{role}__address": "usb", f"instruments__{role}__identity__serial": "C300123"}
    described(first, "on-the-bench", **real)
    half = {"station__scope__address": "TCPIP::scope::INSTR", "instruments__scope__identity__serial": "C300123"}
    described(first, "half-of-it", station__mixed=True, **half)
    say_of(RunPaths(folder / "run-007"), "fibre touched", tags=["good"], star=True)
    return folder


@pytest.fixture(scope="module")
def page(window: Browser, runs: Path) -> Iterator[Page]:
    with dashboard(runs) as served, let_in(window, served) as found:
        yield found


def test_runs_are_found_by_what_their_rows_read(page: Page) -> None:
    page.goto(page.url.partition("?")[0])
    connected(page)
    rows, search = page.locator("a.run"), page.get_by_label("Search")
    expect(rows).to_have_count(200)
    page.get_by_role("button", name="Show more").click()
    expect(rows).to_have_count(RUNS)
    for words, count in {
        "seed 1005": 1,
        "run-007": 1,
        "mnist": RUNS,
        "bench.toml": 1,
        "of 6 shots": RUNS,
        "twin 1 mixed": 1,
        "real": 1,
        "good complete": 1,
        "images >= 4 and tag = good": 1,
    }.items():
        search.fill(words)
        expect(rows, words).to_have_count(min(count, 400))
    search.fill("imagse > 3")
    expect(page.locator(".all-region")).to_have_text("imagse: no run here has that: did you mean images?")


def test_the_address_keeps_words_columns_and_order(page: Page) -> None:
    page.goto(page.url.partition("?")[0])
    connected(page)
    page.get_by_label("Search").fill("seed >= 1000")
    page.get_by_label("Columns").click()
    page.get_by_role("option", name="dataset", exact=True).click()
    page.keyboard.press("Escape")
    expect(page.locator(".head")).to_contain_text("dataset")
    page.locator(".head a", has_text="seeds").click()
    page.wait_for_url("**sort=seed*")
    connected(page)
    expect(page.locator("a.run").first).to_contain_text(f"run-{RUNS - 3:03d}")
    expect(page.locator("a.run").first).to_contain_text("mnist-0-3")
    page.locator("a.run").first.click()
    page.wait_for_url("**/run/*")
    page.go_back()
    expect(page.get_by_label("Search")).to_have_value("seed >= 1000")
    fits(page)
    narrow(page)


def test_runs_that_are_not_real_look_it(page: Page) -> None:
    base = page.url.partition("?")[0]
    page.goto(f"{base}?where=twin 1 mixed or real")
    connected(page)
    expect(page.locator("a.run.mixed .bench")).to_have_text("mixed")
    expect(page.locator("a.run.real .bench")).to_have_text("real")
    for run, band in {"run-007": "SIMULATED BENCH", "half-of-it": "MIXED BENCH"}.items():
        page.goto(f"{base}run/{run}")
        connected(page)
        expect(page.locator(".not-real")).to_contain_text(band)
        expect(page.locator("body")).not_to_have_css("background-image", "none")
    page.goto(f"{base}run/on-the-bench")
    connected(page)
    expect(page.locator(".not-real")).to_have_count(0)
    expect(page.locator("body")).to_have_css("background-image", "none")
    page.goto(f"{base}compare/on-the-bench/half-of-it")
    connected(page)
    expect(page.locator(".not-real")).to_contain_text("MIXED BENCH")
    page.goto(base)
