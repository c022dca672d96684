"""Pages of runs in a store, in a real browser: looked at, compared and searched, and nothing is written."""

from collections.abc import Iterator
from pathlib import Path
from shutil import copytree

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs the extra `dashboard`")
pytest.importorskip("playwright", reason="a browser is driven by playwright")
pytest.importorskip("moto", reason="a store is served by moto")

from playwright.sync_api import Browser, Page, expect

from labctl.bench.station import Station
from labctl.engine.session import Acquisition, acquire
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import say_of
from protocols.image_readout import ImageReadout
from tests.dashboard.browser import connected, dashboard, let_in, narrow, needs_chromium, says
from tests.stores import Traffic, bucket_of

BUCKET = "s3://shelf/lab"

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two whole runs of the same images, one with notes and a report, and one that lacks its last shards."""
    folder = tmp_path_factory.mktemp("lab")
    for name, drive_seed in (("first", 1), ("second", 2)):
        asked = ImageReadout(images=48, classes=(0, 1), window=0.4e-9, ports=(2, 3), drive_seed=drive_seed)
        acquire(Acquisition(asked, Station(), folder / name))
    say_of(RunPaths(folder / "second"), "fibre touched", tags=["good"], star=True, operator="ada")
    (folder / "second" / "report.html").write_text("<h1>what came of it</h1>", "utf-8")
    cut = copytree(folder / "first", folder / "cut")
    (cut / "data.h5").unlink()
    lines = (cut / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (cut / "journal.jsonl").write_bytes(b"".join(lines[:-1]))
    return folder


@pytest.fixture(scope="module")
def bucket(lab: Path) -> Iterator[Traffic]:
    """The same in a store."""
    with bucket_of(lab, BUCKET) as traffic:
        yield traffic


@pytest.fixture(scope="module")
def here(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder in which the dashboard is started, and where what is known of the store is kept."""
    folder = tmp_path_factory.mktemp("here")
    (folder / "second").mkdir()
    (folder / "second" / "report.html").write_text("of another run of that name", "utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        patch.chdir(folder)
        yield folder


@pytest.fixture(scope="module")
def page(window: Browser, bucket: Traffic, here: Path) -> Iterator[Page]:
    """The list; what was done to the store by all tests is looked at in the end."""
    with dashboard(BUCKET) as served, let_in(window, served) as found:
        yield found
    assert bucket.writing == []
    assert {path.name for path in here.iterdir()} == {"second", "cache"}


def shown(page: Page, *path: str) -> None:
    page.goto("/".join((*page.url.split("/")[:4], *path)))
    connected(page)


def test_runs_in_a_store_are_listed_and_searched(page: Page) -> None:
    shown(page, "")
    rows, search = page.locator("a.run"), page.get_by_label("Search")
    expect(rows).to_have_count(3)
    says(page, ".elsewhere", r"s3://shelf/lab is elsewhere: it is shown as it was at \d\d:\d\d:\d\d UTC")
    search.fill("tag = good and drive_seed = 2")
    expect(rows).to_have_count(1)
    says(page, "a.run", "second")
    search.fill("")
    expect(rows).to_have_count(3)
    narrow(page)


@pytest.mark.parametrize("run", ["second", "cut"])
def test_a_run_in_a_store_is_shown_and_nothing_can_be_done_to_it(page: Page, run: str) -> None:
    shown(page, "run", run)
    says(page, ".elsewhere", f"s3://shelf/lab/{run} is elsewhere: .* where it was measured")
    says(page, ".ports-region", "port 2")
    says(page, ".instruments-region", "Tektronix|TEKTRONIX")
    says(page, ".log-region", "image-readout started")
    for name in ("Resume", "Pause", "Stop now", "Add note", "I have seen"):
        expect(page.get_by_role("button", name=name)).to_have_count(0)
    page.get_by_text("Signals: levels").click()
    says(page, ".levels-region", "port 3")
    expect(page.get_by_role("button", name="Keep a picture")).to_have_count(0)


def test_what_is_said_of_a_run_in_a_store_and_its_report_are_read(page: Page) -> None:
    shown(page, "run", "second")
    says(page, "section.notes", "★ starred · by ada · good")
    says(page, "section.notes", "fibre touched")
    says(page, ".accuracy-region", r"\d % after 48 images")
    page.get_by_role("link", name="Open the report").evaluate("link => link.removeAttribute('target')")
    page.get_by_role("link", name="Open the report").click()
    expect(page.locator("h1")).to_have_text("what came of it")


def test_two_runs_in_a_store_are_compared(page: Page) -> None:
    shown(page, "compare", "first", "second")
    says(page, ".comparison", "protocol.settings.drive_seed")
    says(page, ".ports-region", r"difference \(rms, of the first\): port 2: \d+ %")


@pytest.mark.parametrize("name", ["start", "queue", "live"])
def test_pages_that_make_runs_say_where_that_can_be_done(page: Page, name: str) -> None:
    shown(page, name)
    says(
        page,
        ".elsewhere",
        f"^{BUCKET} is elsewhere: it is only read; open a dashboard on the machine that measures$",
    )


def test_a_store_has_no_sweeps_where_there_are_none(page: Page) -> None:
    shown(page, "sweeps")
    says(page, ".sweeps-region", "no sweeps")


def test_a_store_that_breaks_off_is_one_line_on_the_page(
    window: Browser, lab: Path, bucket: Traffic, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same page works when the store does again."""
    with dashboard(BUCKET):
        pass  # the next one knows what is there, and reads what is looked at
    with dashboard(BUCKET) as served, let_in(window, served) as page:
        monkeypatch.setattr(bucket, "cut", "journal")
        shown(page, "run", "first")
        says(page, ".log-region", "first/journal.jsonl: cannot be read .* see to the connection")
        monkeypatch.setattr(bucket, "cut", "")
        shown(page, "run", "cut")
        says(page, ".ports-region", "port 2")
