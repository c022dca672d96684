"""Ticks are round and inside; panels say what the numbers are, whatever they are."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.dashboard import panels
from labctl.dashboard.charts import Axis
from labctl.dashboard.panels import Choice
from labctl.runs.live.sight import Sight


def sight(looks: int = 16, samples: int = 50, kind: type = np.int8) -> Sight:
    codes: NDArray[np.signedinteger[Any]] = np.random.default_rng(1).integers(-90, 90, (looks, 2, samples)).astype(kind)
    level = np.linspace([0.010, 0.020], [0.012, 0.018], 30)
    return Sight(
        (2, 3),
        40e-12,
        np.full(2, 1e-3),
        np.zeros(2),
        codes,
        np.linspace(0, 3, 30),
        level,
        np.linspace([1, 1], [0.95, 0.9], 30),
        np.array([0.05, 0.02]),
        30,
        9.9,
    )


@pytest.mark.parametrize(
    ("axis", "written"),
    [
        (Axis(0, 2e-9, "ns", 1e9), ["0.0", "0.5", "1.0", "1.5", "2.0 ns"]),
        (Axis(-0.128, 0.127, "mV", 1e3), ["-100", "-50", "0", "50", "100 mV"]),
        (Axis(0.99, 1.0), ["0.990", "0.992", "0.994", "0.996", "0.998", "1.000"]),
        (Axis(0, 0), ["0"]),
    ],
)
def test_ticks_are_round_and_inside(axis: Axis, written: list[str]) -> None:
    assert [text for _, text in axis.ticks] == written
    assert all(-1e-9 <= place <= 1 + 1e-9 for place, _ in axis.ticks)


def test_the_scale_of_traces_stays_unless_it_is_free() -> None:
    seen = sight()
    other = replace(seen, recent=np.full_like(seen.recent, 3))
    scales = [panels.signals(one, Choice()).split('<div class="y">')[1].split("</div>")[0] for one in (seen, other)]
    assert scales[0] == scales[1]
    free = [
        panels.signals(one, Choice(free=True)).split('<div class="y">')[1].split("</div>")[0] for one in (seen, other)
    ]
    assert free[0] != free[1]
    assert "1.0 ns" in panels.signals(seen, Choice(part=(0.25, 0.55)))


def test_a_clipped_trace_is_said() -> None:
    seen = sight()
    assert "CLIPPED" not in panels.levels(seen)
    assert "no sample is at an end" in panels.codes(seen)
    cut = seen.recent.copy()
    cut[0, 1, :8] = 127
    clipped = replace(seen, recent=cut)
    assert panels.levels(clipped).count("CLIPPED") == 1
    assert "port 3 1 %" in panels.codes(clipped)


def test_the_bars_hold_the_highest_level_and_the_tone_follows() -> None:
    drawn = panels.levels(sight())
    assert f'aria-valuenow="{1e3 * sight().volts[-1, 0].mean():.2f}"' in drawn
    assert "<small>50.00</small>" in drawn
    assert 'data-tones="' in drawn


@pytest.mark.parametrize("kind", [np.int8, np.int16])
@pytest.mark.parametrize(("looks", "samples"), [(1, 1), (1, 2), (3, 5), (16, 2500)])
def test_every_panel_is_drawn_of_whatever_there_is(looks: int, samples: int, kind: type) -> None:
    dark = sight(looks, samples, kind)
    dark = replace(
        dark,
        recent=np.zeros_like(dark.recent),
        level_v=np.zeros((1, 2)),
        elapsed_s=np.zeros(1),
        likeness=np.full((1, 2), np.nan),
    )
    for seen in (sight(looks, samples, kind), dark, None):
        for drawn in (
            panels.levels(seen),
            panels.signals(seen, Choice()),
            panels.signals(seen, Choice(free=True)),
            panels.codes(seen),
            panels.frequencies(seen),
            panels.repeats(seen),
            panels.course(seen),
        ):
            assert "nan" not in drawn
            assert "inf" not in drawn
