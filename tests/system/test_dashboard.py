"""The dashboard in a real browser: a run is started, watched, paused and stopped from the page, and it is dark."""

import json
import re
import signal
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from shutil import copytree, rmtree

import pytest

pytest.importorskip("nicegui", reason="the dashboard needs the extra `dashboard`")
pytest.importorskip("playwright", reason="a browser is driven by playwright")

from playwright.sync_api import Browser, Page, expect

from instruments.safe_state import UnsafeBench
from labctl.bench.lock import held
from labctl.bench.station import Station, read_station
from labctl.engine.session import Acquisition, acquire
from labctl.engine.start import carried_out
from labctl.runs.format.layout import RunPaths
from labctl.runs.live.logs import EventLog
from labctl.runs.live.sight import LIVE
from labctl.runs.notes import read_notes, say_of
from labctl.runs.read.run import open_run
from labctl.runs.sweep import Sweep, places
from labctl.studies.sweeps.folder import begin
from protocols.image_readout import ImageReadout
from tests.command_line import LABCTL
from tests.dashboard.browser import (
    Dashboard,
    connected,
    dashboard,
    fits,
    let_in,
    narrow,
    needs_chromium,
    says,
    start_long_run,
)

pytestmark = needs_chromium


BEHIND_THE_LASER = {
    "power_meter": {"driver": "thorlabs-pm100", "tap": 0.01},
    "amplifier": {"driver": "table-amplifier", "commands": "simulated", "power": "100 mW"},
    "attenuator": {"driver": "table-attenuator", "commands": "simulated", "attenuation_db": 3.0},
}


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three runs that are complete, one of them on a bench with more instruments."""
    folder = tmp_path_factory.mktemp("runs")
    more = Station.model_validate(BEHIND_THE_LASER)
    acquire(Acquisition(ImageReadout(images=5, window=0.8e-9, ports=(2,)), more, folder / "behind"))
    for name, seed in (("past-one", 1), ("past-other", 2)):
        asked = ImageReadout(images=5, window=0.8e-9, ports=(2,), seed=seed, image_seed=1)
        acquire(Acquisition(asked, Station(), folder / name))
    return folder


@pytest.fixture(scope="module")
def shown(runs: Path) -> Iterator[Dashboard]:
    with dashboard(runs) as found:
        yield found


@pytest.fixture
def page(window: Browser, shown: Dashboard) -> Iterator[Page]:
    """The page at the address that was printed."""
    with let_in(window, shown) as page:
        expect(page.locator(".all-region")).to_be_visible()
        connected(page)
        yield page


def start(page: Page, station: Path) -> None:
    """Start a long run on the served bench by the form, and wait until it is measuring."""
    start_long_run(page, station, "^1100 shots in 2 passes · .* on a real bench · .* J of light at most .30 mW.")
    says(page, ".emission-region", "LASER ON")
    says(page, ".progress-region", r"[1-9]\d* of 2200 records")


def test_a_run_is_started_watched_paused_and_stopped(
    page: Page, unarmed: Path, runs: Path, emitting: Callable[[], bool]
) -> None:
    start(page, unarmed)
    assert emitting()
    expect(page.locator(".ports-region figure")).to_have_count(4)
    expect(page.locator(".picture-region svg")).to_be_visible()
    says(page, ".instruments-region", "1 ← port 2, 2 ← port 3")
    page.get_by_role("button", name="Pause").click()
    says(page, ".progress-region", "paused")
    says(page, ".emission-region", "LASER OFF")
    assert not emitting()
    page.get_by_role("button", name="Go on").click()
    says(page, ".emission-region", "LASER ON")
    page.get_by_role("button", name="Stop", exact=True).click()
    says(page, ".progress-region", "stopped")
    says(page, ".emission-region", "LASER OFF")
    assert not emitting()
    expect(page.locator(".buttons")).to_be_hidden()
    narrow(page)
    with open_run(runs / page.url.rpartition("/")[2]) as stored:
        assert 0 < stored.done[0] < stored.shape.shots


def test_a_readout_follows_the_run_while_it_is_going_on(page: Page, unarmed: Path) -> None:
    start(page, unarmed)
    says(page, ".progress-region", r"[2-9]\d\d of 2200 records")
    page.get_by_role("button", name="Pause").click()
    says(page, ".following-region", r"[1-9]\d*\.\d % of the last \d+ images, .* since the first 40, ports 2, 3, 4, 5")
    expect(page.locator(".following-region polyline.a")).to_be_attached()
    narrow(page)
    page.get_by_role("button", name="Stop", exact=True).click()
    says(page, ".progress-region", "stopped")


def test_what_nobody_allows_is_refused_and_told(page: Page, unarmed: Path, emitting: Callable[[], bool]) -> None:
    page.get_by_role("link", name="Start a run").click()
    page.wait_for_url("**/start")
    connected(page)
    page.get_by_label("Station file").fill(str(unarmed))
    page.get_by_role("button", name="Start", exact=True).click()
    says(page, ".form .message", "the laser is not armed, no light is switched on")
    assert not emitting()


def test_the_link_is_a_line_of_its_own(tmp_path: Path) -> None:
    command = [*LABCTL, "dashboard", str(tmp_path), "--port", "0", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        link, next_line = process.stdout.readline(), process.stdout.readline()
        process.send_signal(signal.SIGINT)
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/\?token=[\w-]+\n", link)
    assert next_line == "Ctrl-C ends the dashboard; runs go on without it\n"


def test_nothing_is_started_while_somebody_has_the_bench(page: Page, unarmed: Path) -> None:
    with held(read_station(unarmed), "a test"):
        page.get_by_role("link", name="Start a run").click()
        page.wait_for_url("**/start")
        connected(page)
        page.get_by_label("Station file").fill(str(unarmed))
        page.get_by_role("switch").click()
        page.get_by_role("button", name="Start", exact=True).click()
        says(page, ".form .message", r"^awg is in use: a test, process \d+ ")
        expect(page.get_by_role("switch")).not_to_be_checked()


def test_what_a_run_would_cost_and_what_is_refused_is_said_before_it_is_started(page: Page, runs: Path) -> None:
    page.get_by_role("link", name="Start a run").click()
    page.wait_for_url("**/start")
    connected(page)
    images = page.locator(".set-images")
    expect(images.locator("input")).to_have_attribute("placeholder", "1000")
    expect(page.locator(".set-window")).to_contain_text("in s")
    page.get_by_label("images", exact=True).fill("-3")
    expect(images).to_contain_text("'-3' is not a number of images")
    expect(page.locator(".form .refused")).to_be_visible()
    page.get_by_label("images", exact=True).fill("8")
    expect(images).not_to_contain_text("is not a number")
    page.get_by_label("Station file").fill("no\u202esuch.toml")
    says(page, ".form .cost", r"no\\u202esuch\.toml: ")
    page.get_by_label("Station file").fill("")
    says(page, ".form .cost", "^10 shots in 2 passes")
    page.get_by_label("dataset").click()
    expect(page.get_by_role("option", name="fashion-mnist")).to_be_visible()
    expect(page.get_by_role("option", name="santa-fe")).to_have_count(0)
    page.keyboard.press("Escape")
    page.get_by_label("Sweep over").fill("window=0.4 ns,1 ns")
    says(page, ".form .cost", "^3 runs · 30 shots")
    page.get_by_label("Sweep over").fill("")
    page.get_by_label("Protocol").click()
    page.get_by_role("option", name="dynamic-scene").click()
    expect(page.locator(".set-images")).to_have_count(0)
    narrow(page)
    assert not [one for one in runs.iterdir() if "dynamic" in one.name], "nothing is started by looking"


def test_stop_now_brings_the_safe_state(page: Page, unarmed: Path, emitting: Callable[[], bool]) -> None:
    start(page, unarmed)
    page.get_by_role("button", name="Stop now").click()
    says(page, ".progress-region", "stopped")
    says(page, ".emission-region", "LASER OFF")
    says(page, ".log-region", "stopped at once.*safe state reached")
    assert not emitting()


def test_a_run_that_was_stopped_is_resumed_and_refused_without_leave(
    page: Page, unarmed: Path, emitting: Callable[[], bool]
) -> None:
    start(page, unarmed)
    page.get_by_role("button", name="Stop", exact=True).click()
    says(page, ".progress-region", "stopped")
    page.get_by_role("button", name="Resume").click()
    says(page, ".resume .message", "the laser is not armed")
    page.locator(".resume").get_by_role("switch").click()
    page.get_by_role("button", name="Resume").click()
    says(page, ".emission-region", "LASER ON")
    expect(page.locator(".resume")).to_be_hidden()
    page.get_by_role("button", name="Stop now").click()
    says(page, ".emission-region", "LASER OFF")
    assert not emitting()


def may_emit(directory: Path) -> None:
    """The last word about the laser of a run or live view is that it did not go dark."""
    with EventLog() as events:
        events.stored_in(directory)
        events.emission(on=True)
        events.safe_state(UnsafeBench("the laser may still emit", ["laser"]))


def of_a_real_bench(run: Path) -> None:
    manifest = json.loads((run / "manifest.json").read_text("utf-8"))
    for role, instrument in manifest["instruments"].items():
        if instrument.get("identity"):
            manifest["station"][role]["address"], instrument["identity"]["serial"] = "usb", "C300123"
    (run / "manifest.json").write_text(json.dumps(manifest), "utf-8")
    (run / "events.jsonl").unlink()


def test_a_laser_that_did_not_go_dark_is_said_on_every_page_until_somebody_has_seen_it_dark(
    page: Page, runs: Path
) -> None:
    base = page.url
    run, view = copytree(runs / "past-one", runs / "past-alarm"), runs / LIVE / "20261129T120000Z-1"
    begin(runs / "past-sweep", Sweep(protocol="image-readout", over={"power": ("1 mW",)}), ImageReadout, Station())
    view.mkdir(parents=True)
    try:
        of_a_real_bench(run)
        may_emit(run)
        with EventLog() as events:
            events.stored_in(view)
            events.event("live started", ports=[2], origin="simulated", **carried_out(Station()))
        may_emit(view)
        lit = page.get_by_role("alert").filter(has_text="past-alarm")
        seen = page.get_by_role("alert").filter(has_text="live view 20261129T120000Z-1")
        others = ("queue", "live", "sweeps", "sweep/past-sweep", "run/past-one", "run/nothing", "start")
        for address in ("", "compare/past-one/past-other", *others):
            page.goto(f"{base}{address}")
            connected(page)
            expect(lit.locator("strong")).to_have_text("LASER MAY STILL EMIT")
            expect(lit.locator(".emission")).to_have_css("background-color", "rgb(196, 0, 26)")
            expect(seen.locator("strong")).to_have_text("SIMULATED LASER MAY STILL EMIT")
            expect(seen.locator(".emission")).not_to_have_css("background-color", "rgb(196, 0, 26)")
            narrow(page)
        lit.click()
        page.wait_for_url("**/run/past-alarm")
        connected(page)
        expect(seen).to_have_count(1)
        expect(lit).to_have_count(0)
        says(page, ".emission-region", "LASER MAY STILL EMIT")
        page.get_by_role("button", name="I have seen that the laser is dark").click()
        says(page, ".emission-region", "LASER OFF")
        seen.click()
        page.wait_for_url("**/live/20261129T120000Z-1")
        connected(page)
        says(page, ".emission-region", "SIMULATED LASER MAY STILL EMIT")
        page.get_by_role("button", name="I have seen that the laser is dark").click()
        says(page, ".emission-region", "LASER OFF")
        page.get_by_role("link", name="labctl").click()
        expect(page.locator(".all-region")).to_contain_text("past-alarm")
        expect(page.get_by_role("alert")).to_have_count(0)
    finally:
        for made in (run, runs / LIVE, runs / "past-sweep"):
            rmtree(made)


def test_what_stands_behind_the_laser_is_shown_with_the_other_instruments(page: Page) -> None:
    page.goto(f"{page.url}run/behind")
    connected(page)
    for words in (
        "power meter.*saw the laser give 30 mW, tap 1 %.*Thorlabs PM100D .simulated. SIM0001 at simulated",
        "amplifier.*off, set to 100 mW.*labctl optical amplifier .simulated. SIM0001 at simulated",
        "attenuator.*shut, set to 3 dB.*labctl optical attenuator .simulated. SIM0001 at simulated",
        "oscilloscope.*TEKTRONIX DPO72504DX SIM0001 at simulated",
    ):
        says(page, ".instruments-region", words)
    page.locator(".instrument.scope").click()
    says(page, ".instrument.scope", "set, by the station file.*bandwidth.*read back before the first shot.*sample_rate")
    says(page, ".instrument.scope .messages", "CURVe")
    narrow(page)


def test_runs_are_listed_filtered_and_compared(page: Page) -> None:
    narrow(page)
    rows = page.locator("a.run")
    page.get_by_label("Search").fill("past incomplete")
    expect(rows).to_have_count(0)
    page.get_by_label("Search").fill("past complete")
    expect(rows).to_have_count(2)
    fits(page)
    rows.filter(has_text="past-one").click()
    page.wait_for_url("**/run/past-one")
    connected(page)
    page.get_by_label("Compare with").click()
    page.get_by_role("option", name="past-other").click()
    page.wait_for_url("**/compare/past-one/past-other")
    connected(page)
    expect(page.locator(".differing")).to_contain_text("protocol.settings.seed")
    expect(page.locator(".ports-region polyline.b")).to_be_attached()
    picture = page.get_by_label("Picture")
    expect(picture).to_have_value(re.compile(r"image \d+, class \d"))
    says(page, ".ports-region", re.escape(picture.input_value()) + r"; difference .rms, of the first.: port 2: \d+ %")
    fits(page)


def test_a_run_of_a_sweep_is_compared(page: Page, runs: Path) -> None:
    sweep = Sweep(protocol="image-readout", over={"power": ("1 mW",)})
    begin(runs / "50% sweep", sweep, ImageReadout, Station())
    (point, _), *_ = places(sweep)
    copytree(runs / "past-one", runs / "50% sweep" / point)
    page.goto(f"{page.url}run/50%25 sweep%2F{point}")
    connected(page)
    page.get_by_label("Compare with").click()
    page.get_by_role("option", name="past-other").click()
    expect(page.locator(".differing")).to_contain_text("protocol.settings.seed")
    expect(page.locator(".differing")).to_contain_text(f"50% sweep/{point}")
    rmtree(runs / "50% sweep")


def test_a_run_that_cannot_be_read_is_not_compared_and_says_why(page: Page, runs: Path) -> None:
    broken = copytree(runs / "past-one", runs / "broken")
    (broken / "plan.h5").write_bytes(b"no plan")
    page.goto(f"{page.url}compare/past-other/broken")
    connected(page)
    says(page, ".comparison .problem", "broken/plan.h5: ")
    expect(page.locator(".differing")).to_have_count(0)
    rmtree(broken)


def test_a_run_with_a_line_break_in_its_name_has_a_page(page: Page, runs: Path) -> None:
    odd = copytree(runs / "past-one", runs / "odd\nname %2F")
    (odd / "report.html").write_text("<h1>Report</h1>")
    page.locator("a.run", has_text="odd").click()
    says(page, ".progress-region", "finished")
    with page.expect_popup() as opening:
        page.get_by_text("Open the report").click()
    expect(opening.value.locator("h1")).to_have_text("Report")
    rmtree(odd)


def test_what_is_said_of_a_run_is_kept_with_it_and_finds_it(page: Page, runs: Path) -> None:
    base = page.url
    page.goto(f"{base}run/past-other")
    connected(page)
    page.get_by_role("button", name="star").click()
    expect(page.get_by_role("button", name="starred")).to_be_visible()
    page.get_by_label("Operator").fill("Ada")
    page.get_by_label("Operator").press("Enter")
    page.get_by_label("Tags").fill("good")
    page.get_by_label("Tags").press("Enter")
    page.get_by_label("Note").fill("fibre <b>touched</b>")
    page.get_by_role("button", name="Add note").click()
    expect(page.locator(".notes-region li")).to_contain_text("fibre <b>touched</b>")
    narrow(page)
    found = read_notes(RunPaths(runs / "past-other"))
    assert (found.star, found.operator, found.tags) == (True, "Ada", ("good",))
    page.goto(f"{base}?where=tag %3D good and star %3D 1 and operator %3D ada and touched")
    connected(page)
    expect(page.locator("a.run")).to_have_count(1)
    page.goto(f"{base}run/past-other")
    connected(page)
    page.locator(".tags .q-chip__icon--remove").click()
    page.wait_for_function("!document.querySelector('.tags .q-chip')")
    page.get_by_role("button", name="starred").click()
    expect(page.get_by_role("button", name="star", exact=False)).to_have_text("☆ star")


def test_what_others_say_of_a_run_stays_and_is_shown(page: Page, runs: Path) -> None:
    run = RunPaths(copytree(runs / "past-one", runs / "past-noted"))
    say_of(run, tags=["first"])
    page.goto(f"{page.url}run/past-noted")
    connected(page)
    tags, chips = page.get_by_label("Tags"), page.locator(".tags .q-chip__content")
    expect(chips).to_have_text(["first"])
    tags.fill("x" * 200)
    say_of(run, tags=["theirs"], star=True, operator="Ada")
    tags.press("Enter")
    says(page, ".notes .message", "write 1 to 100 characters")
    expect(chips).to_have_text(["first", "theirs"])
    tags.fill("mine")
    tags.press("Enter")
    expect(chips).to_have_text(["first", "mine", "theirs"])
    expect(page.get_by_role("button", name="starred")).to_be_visible()
    expect(page.get_by_label("Operator")).to_have_value("Ada")
    page.locator(".tags .q-chip", has_text="first").locator(".q-chip__icon--remove").click()
    expect(chips).to_have_text(["mine", "theirs"])
    found = read_notes(run)
    assert (found.star, found.operator, found.tags) == (True, "Ada", ("mine", "theirs"))
    rmtree(run.directory)


def test_a_report_is_shown_without_its_scripts(page: Page, runs: Path) -> None:
    for name in ("with-report", "with-link"):
        copytree(runs / "past-one", runs / name)
    (runs / "with-report" / "report.html").write_text("<h1>Report</h1><script>document.title = 'stolen'</script>")
    (runs / "with-link" / "report.html").symlink_to("/etc/hostname")
    base = page.url
    page.goto(f"{base}run/with-report")
    with page.expect_popup() as opening:
        page.get_by_text("Open the report").click()
    expect(opening.value.locator("h1")).to_have_text("Report")
    assert opening.value.title() != "stolen"
    for name in ("with-link", "nothing", "..%2fwith-report"):
        assert page.request.get(f"{base}report/{name}").status == 404
    page.goto(f"{base}run/nothing")
    expect(page.get_by_text("has no run nothing")).to_be_visible()
