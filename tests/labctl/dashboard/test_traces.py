"""Traces on a page: all of a record is inside its plot, and its peaks are there however long it is."""

import re
from pathlib import Path

import numpy as np
import pytest

from labctl.bench.station import Station
from labctl.dashboard import wording
from labctl.dashboard.charts import Axis, Curve, chart
from labctl.dashboard.sketches import MOST_POINTS
from labctl.engine.session import Acquisition, acquire
from labctl.runs.read.follower import Follower, Latest
from protocols.image_readout import ImageReadout


def measured(directory: Path, window: float) -> tuple[list[Latest], float]:
    """The last shot of a run at one port, and its sample interval."""
    acquire(Acquisition(ImageReadout(images=4, ports=(2,), window=window), Station(), directory))
    run = Follower(directory)
    while run.look():
        pass
    return run.latest(), run.shape.sample_interval_s


def points(drawn: str, style: str) -> list[tuple[int, int]]:
    """Of a line: thousandths of the plot's width and height, from its upper left corner."""
    found = re.search(rf'<polyline class="{style}" points="([^"]*)"', drawn)
    assert found is not None
    return [(int(x), int(y)) for x, y in (point.split(",") for point in found[1].split())]


def test_traces_of_two_runs_are_inside_their_plot_whichever_is_longer(tmp_path: Path) -> None:
    short, interval_s = measured(tmp_path / "short", 0.5e-9)
    long, _ = measured(tmp_path / "long", 2e-9)
    for one, other, longer in ((short, long, "b"), (long, short, "a")):
        drawn = wording.traces(one, interval_s, other)
        reach = {style: points(drawn, style)[-1][0] for style in ("a", "b")}
        assert reach.pop(longer) == 1000
        (rest,) = reach.values()
        assert rest < 300
        assert re.search(r"<span>(2|1\.\d+) ns</span>", drawn)


def test_a_long_trace_has_its_highest_and_lowest_samples(tmp_path: Path) -> None:
    latest, interval_s = measured(tmp_path / "run", 50e-9)
    (one,) = latest
    (volts,), ((low, high),) = one.volts, one.ends
    drawn = points(wording.traces(latest, interval_s), "a")
    assert len(drawn) <= MOST_POINTS < volts.size
    heights = [y for _, y in drawn]
    for height, extreme in ((min(heights), volts.max()), (max(heights), volts.min())):
        assert height == pytest.approx(1000 - 1000 * (extreme - low) / (high - low), abs=1)
    time_s = np.arange(volts.size) * interval_s
    panel = chart("port 2", [Curve(time_s, volts)], Axis(0.0, float(time_s[-1])), Axis(low, high))
    assert [y for _, y in points(panel, "c0")] == heights
    places = [x for x, _ in drawn]
    assert places == sorted(places)
