"""The sweeps in a folder, as the pages have them."""

import re
import shutil
from pathlib import Path

import pytest

from instruments.safe_state import UnsafeBench
from labctl.bench.station import SIMULATED_STATION, Station
from labctl.dashboard.sweep_accuracy import Recognition
from labctl.dashboard.sweep_pages import sweep_plot
from labctl.dashboard.sweeps import Point, Sweeps, SweepState
from labctl.engine.session import Acquisition, acquire
from labctl.runs.format.origin import Origin
from labctl.runs.live.alarm import say_dark
from labctl.runs.live.logs import EventLog
from labctl.runs.sweep import FILE, Sweep, places
from labctl.studies.sweeps.folder import begin
from protocols.image_readout import ImageReadout


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Runs with a sweep of which one point is measured, and a file of a sweep that is none."""
    sweep = Sweep(protocol="image-readout", over={"window": ("0.4 ns", "1 ns")}, reference_every=0)
    begin(tmp_path / "runs" / "power", sweep, ImageReadout, SIMULATED_STATION)
    (name, _), _ = places(sweep)
    acquire(Acquisition(ImageReadout(images=4, ports=(2,)), Station(), tmp_path / "runs" / "power" / name))
    (tmp_path / "runs" / "broken").mkdir()
    (tmp_path / "runs" / "broken" / FILE).write_text("{}")
    return tmp_path / "runs"


def test_how_far_a_sweep_is_and_which_of_its_runs_are_pages(folder: Path) -> None:
    now = [0.0]
    sweeps = Sweeps(folder, lambda: now[0])
    power, broken = sweeps.all()
    assert (power.complete, len(power.points), power.running) == (1, 2, False)
    assert "not such a file" in broken.problem
    done, waiting = power.points
    assert sweeps.has_point(f"power/{done.name}")
    for name in (f"power/{waiting.name}", "power", "power/..", "../runs", f"power/{done.name}/shards"):
        assert not sweeps.has_point(name)
    shutil.rmtree(folder / "power")
    now[0] = 60.0
    assert [state.name for state in sweeps.all()] == ["broken"]


def test_what_has_just_come_has_its_page_at_once(folder: Path) -> None:
    sweeps = Sweeps(folder, lambda: 0.0)
    known = sweeps.named("power")
    assert known is not None
    (done, waiting), late = known.points, folder / "late"
    assert sweeps.named("late") is None
    shutil.copytree(folder / "power", late)
    assert sweeps.named("late") is not None
    assert not sweeps.has_point(f"late/{waiting.name}")
    shutil.copytree(late / done.name, late / waiting.name)
    assert sweeps.has_point(f"late/{waiting.name}")
    assert not sweeps.has_point("nothing/here")


def test_what_is_put_in_the_place_of_a_run_or_sweep_is_looked_at(folder: Path) -> None:
    sweep = Sweep(protocol="image-readout", over={"window": ("0.4 ns",)}, reference_every=0)
    begin(folder / "one", sweep, ImageReadout, SIMULATED_STATION)
    ((name, _),) = places(sweep)
    acquire(Acquisition(ImageReadout(images=4, ports=(2,)), Station(), folder / "one" / name))
    now = [0.0]
    sweeps = Sweeps(folder, lambda: now[0])
    before = sweeps.named("one")
    assert before is not None
    assert [point.row.shots for point in before.points if point.row] == [6]
    shutil.rmtree(folder / "one" / name)
    acquire(Acquisition(ImageReadout(images=5, ports=(2,)), Station(), folder / "one" / name))
    now[0] = 60.0
    replaced = sweeps.named("one")
    assert replaced is not None
    assert [point.row.shots for point in replaced.points if point.row] == [7]
    shutil.rmtree(folder / "one")
    shutil.copytree(folder / "power", folder / "one")
    now[0] = 120.0
    another = sweeps.named("one")
    assert another is not None
    assert (another.complete, len(another.points)) == (1, 2)


def test_a_sweep_whose_runs_are_in_a_store_says_where_to_look(tmp_path: Path) -> None:
    sweep = Sweep(protocol="image-readout", over={"window": ("0.4 ns", "1 ns")})
    begin(tmp_path / "runs" / "far", sweep, ImageReadout, SIMULATED_STATION, store=tmp_path / "store")
    (far,) = Sweeps(tmp_path / "runs").all()
    assert far.points == ()
    assert far.problem.endswith(
        f"its runs are in {tmp_path}/store: look at them with 'labctl dashboard {tmp_path}/store'"
    )


def test_a_laser_of_a_sweep_that_did_not_go_dark_is_told_until_somebody_has_seen_it_dark(folder: Path) -> None:
    now = [0.0]
    sweeps = Sweeps(folder, lambda: now[0])
    point = sweeps.all()[0].points[0]
    assert sweeps.alarms() == {}
    with EventLog() as events:
        events.stored_in(folder / "power" / point.name)
        events.emission(on=True)
        events.safe_state(UnsafeBench("the laser may still emit", ["laser"]))
    fresh = Sweeps(folder, lambda: now[0])
    assert fresh.alarms() == {f"power/{point.name}": Origin.SIMULATED}
    say_dark(folder / "power" / point.name)
    now[0] = 60.0
    assert fresh.alarms() == {}


def test_a_plot_has_a_curve_for_each_value_of_the_other_axes() -> None:
    state = planned({"window": ("0.4 ns", "1 ns", "2 ns"), "power": ("10 mW", "30 mW")})
    known = {point.name: Recognition(0.8, 0.7, 0.9, 0.25) for point in state.points[:4]}
    drawn = sweep_plot(state, known)
    assert "accuracy against window, 4 of 6 runs" in drawn
    assert ("power 10 mW" in drawn, "power 30 mW" in drawn, "power 20 mW" in drawn) == (True, True, False)
    assert "no run is complete yet" in sweep_plot(state, {})


def planned(over: dict[str, tuple[str, ...]]) -> SweepState:
    sweep = Sweep(protocol="image-readout", over=over, reference_every=0)
    return SweepState("one", sweep, tuple(Point(name, values, None) for name, values in places(sweep)))


@pytest.mark.parametrize(
    "values",
    [
        ("2 ns", "0.4 ns", "1 ns"),
        ("800 ps", "1 ns", "1.2 ns", "1.4 ns", "1600 ps"),
        ("software", "burst", "none", "other"),
    ],
)
def test_points_lie_by_their_quantities_and_words_as_they_were_given(values: tuple[str, ...]) -> None:
    state = planned({"window": values})
    in_order = ["0.4 ns", "1 ns", "2 ns"] if "2 ns" in values else list(values)
    known = {
        point.name: Recognition(in_order.index(point.values["window"]) / 10, 0.0, 1.0, 0.25) for point in state.points
    }
    drawn = sweep_plot(state, known)
    (line,) = re.findall(r'<polyline class="a" points="((?:\d+,\d+ ?){3,})"', drawn)
    heights = [int(point.split(",")[1]) for point in line.split()]
    assert heights == [1000 - 100 * place for place in range(len(values))]
    assert f'<div class="x"><span>{in_order[0]}</span><span>{in_order[-1]}</span></div>' in drawn
