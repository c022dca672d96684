import sys
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image, ImageColor

import labctl
from instruments.values import Scaling
from labctl.engine.hands import Traces
from labctl.errors import LabctlError
from labctl.reports import live_trace
from labctl.reports.canvas import PURPLE
from labctl.reports.live_trace import LiveTrace, trace_figure
from labctl.reports.pictures import png_of
from labctl.runs.format.origin import Origin
from tests.labctl.reports.figures.drawn import check_figure, legend

TIME_S = np.linspace(0, 0.96e-9, 25)


def test_a_trace_names_its_ports_and_its_place(tmp_path: Path) -> None:
    def draw() -> Any:
        return trace_figure(TIME_S, np.ones((2, 25)), (2, 0), ends_v=(0, 1), count=7)

    check_figure(draw, tmp_path)
    assert legend(draw()) == ["port 2", "before the chip"]
    assert draw().axes[0].get_title() == "trace 7"


def test_the_scale_never_shrinks(monkeypatch: pytest.MonkeyPatch) -> None:
    ends = []

    def remember(*_: Any, ends_v: tuple[float, float], count: int) -> Any:
        ends.append((count, ends_v))
        return trace_figure(TIME_S, np.ones((1, 25)), (2,), ends_v=ends_v, count=count)

    monkeypatch.setattr(live_trace, "trace_figure", remember)
    view = LiveTrace()
    for level in (0.2, 0.5, -0.3, 0.1):
        view.show(TIME_S, np.full((1, 25), level), (2,), Origin.REAL)
    assert ends == [(1, (0, 0.2)), (2, (0, 0.5)), (3, (-0.3, 0.5)), (4, (-0.3, 0.5))]


def test_the_whole_trace_is_seen_also_below_zero() -> None:
    volts = np.linspace(-1e-3, 0.6e-3, 25)[np.newaxis]
    axes = trace_figure(TIME_S, volts, (2,), ends_v=(-1e-3, 0.6e-3), count=1).axes[0]
    drawn = axes.lines[0].get_ydata()
    low, high = axes.get_ylim()
    assert low < np.min(drawn) < np.max(drawn) < high
    assert "mV" in axes.get_ylabel()


@pytest.mark.parametrize("origin", Origin)
def test_what_is_simulated_is_marked_as_in_any_figure(origin: Origin, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[Any] = []
    monkeypatch.setattr("IPython.display.display", lambda picture, **_: shown.append(picture))
    LiveTrace().show(TIME_S, np.ones((1, 25)), (2,), origin)
    figure = trace_figure(TIME_S, np.ones((1, 25)), (2,), ends_v=(0, 1), count=1)
    assert shown[0].data == png_of(figure, origin)
    with Image.open(BytesIO(shown[0].data)) as picture:
        colours = {colour for _, colour in picture.convert("RGB").getcolors(1 << 20) or ()}
    assert (ImageColor.getrgb(PURPLE) in colours) == (origin is not Origin.REAL)


def test_the_last_trace_comes_back() -> None:
    codes, scalings = np.zeros((1, 25), np.int8), (Scaling(1, 0),)
    last = Traces(np.ones((1, 25)), TIME_S, (3,), np.zeros(1, np.bool_), codes, scalings, Origin.REAL)
    assert labctl.live_trace([last]) is last
    with pytest.raises(ValueError, match="no trace to show"):
        labctl.live_trace([])


def test_without_a_notebook_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "IPython.display", None)
    with pytest.raises(LabctlError, match="pip install jupyter"):
        LiveTrace()
