"""Traces on a page: all of a record is inside its plot, and its peaks are there however long it is."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from labctl.bench.station import Station
from labctl.dashboard import wording
from labctl.dashboard.charts import Axis, Curve, chart
from labctl.dashboard.comparison_page import difference
from labctl.dashboard.sketches import MOST_POINTS
from labctl.engine.session import Acquisition, acquire
from labctl.runs.read.follower import Follower, Latest
from protocols.image_readout import ImageReadout


def measured(directory: Path, window: float) -> list[Latest]:
    """The last shot of a run at one port."""
    acquire(Acquisition(ImageReadout(images=4, ports=(2,), window=window), Station(), directory))
    run = Follower(directory)
    while run.look():
        pass
    return run.latest()


def points(drawn: str, style: str) -> list[tuple[int, int]]:
    """Of a line: thousandths of the plot's width and height, from its upper left corner."""
    found = re.search(rf'<polyline class="{style}" points="([^"]*)"', drawn)
    assert found is not None
    return [(int(x), int(y)) for x, y in (point.split(",") for point in found[1].split())]


def test_traces_of_two_runs_are_inside_their_plot_whichever_is_longer(tmp_path: Path) -> None:
    short = measured(tmp_path / "short", 0.48e-9)
    long = measured(tmp_path / "long", 2e-9)
    for one, other, longer in ((short, long, "b"), (long, short, "a")):
        drawn = wording.traces(one, other)
        reach = {style: points(drawn, style)[-1][0] for style in ("a", "b")}
        assert reach.pop(longer) == 1000
        (rest,) = reach.values()
        assert rest < 300
        assert re.search(r"<span>(2|1\.\d+) ns</span>", drawn)


def test_each_trace_of_two_runs_has_its_own_time(tmp_path: Path) -> None:
    (one,) = measured(tmp_path / "run", 0.48e-9)
    finer = replace(one, sample_interval_s=one.sample_interval_s / 2)
    for first, second, longer in ((one, finer, "a"), (finer, one, "b")):
        drawn = wording.traces([first], [second])
        reach = {style: points(drawn, style)[-1][0] for style in ("a", "b")}
        assert reach.pop(longer) == 1000
        assert reach.popitem()[1] == pytest.approx(500, abs=1)
    assert difference([one], [one]) == {2: 0.0}
    assert difference([one], [finer]) == {}, "there is nothing to subtract"


def test_a_long_trace_has_its_highest_and_lowest_samples(tmp_path: Path) -> None:
    (one,) = measured(tmp_path / "run", 50e-9)
    (volts,), ((low, high),) = one.volts, one.ends
    drawn = points(wording.traces([one]), "a")
    assert len(drawn) <= MOST_POINTS < volts.size
    heights = [y for _, y in drawn]
    for height, extreme in ((min(heights), volts.max()), (max(heights), volts.min())):
        assert height == pytest.approx(1000 - 1000 * (extreme - low) / (high - low), abs=1)
    time_s = np.arange(volts.size) * one.sample_interval_s
    panel = chart("port 2", [Curve(time_s, volts)], Axis(0.0, float(time_s[-1])), Axis(low, high))
    assert [y for _, y in points(panel, "c0")] == heights
    places = [x for x, _ in drawn]
    assert places == sorted(places)
