from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.analysis.decorrelation import Decorrelation
from labctl.analysis.drive_depth import DriveDepth
from labctl.analysis.estimates import Estimate
from labctl.analysis.light_delay import LightDelay
from labctl.reports.figures.alignment import (
    contrast_figure,
    dark_figure,
    delay_figure,
    depth_figure,
    range_figure,
    repeats_figure,
    scan_figure,
)
from tests.labctl.reports.figures.drawn import check_figure, legend, noise

CHANNELS = (1, 3)
INTERVAL_S = 40e-12


def dark() -> Figure:
    return dark_figure(1e-3 * noise(32, 2, 100), CHANNELS)


def ranges() -> Figure:
    full_scale_v = np.array([0.2, 0.3])
    return range_figure(noise(2, 4, 2, 40), CHANNELS, full_scale_v=full_scale_v, to_be_used=0.6, interval_s=INTERVAL_S)


def repeats() -> Figure:
    return repeats_figure(noise(48, 2, 40), CHANNELS, interval_s=INTERVAL_S)


def contrast() -> Figure:
    return contrast_figure(noise(2, 4, 2, 40), CHANNELS, interval_s=INTERVAL_S)


def delay() -> Figure:
    time_s = np.linspace(-0.12e-9, 0.8e-9, 47)
    power = np.where(time_s > 0, np.exp(-time_s / 0.3e-9), 0.01)
    found = LightDelay(Estimate(1e-9, 1e-12), Estimate(3e-10, 1e-12), Estimate(1e-11, 1e-12), time_s, power, power)
    return delay_figure(found, Estimate(98.0016e-9, 1e-12), hold_s=INTERVAL_S)


def depth() -> Figure:
    levels, phase = np.linspace(-1, 1, 3), np.linspace(0, 6.3, 3)
    return depth_figure(DriveDepth(Estimate(6.3, 0.1), levels, phase, ((0, 1), (1, 2)), noise(2, 2), noise(2, 2)))


def scan(half_width_nm: float | None = 0.01) -> Figure:
    detuning_nm = np.linspace(0, 0.06, 14)
    correlation = 1 / (1 + (detuning_nm / 0.01) ** 2)
    return scan_figure(Decorrelation(detuning_nm, correlation, "measured", half_width_nm, None, 16, 0.3))


def test_they_are_sound(tmp_path: Path) -> None:
    for draw in (dark, ranges, repeats, contrast, delay, depth, scan):
        check_figure(draw, tmp_path)


def test_a_panel_is_a_channel_of_the_oscilloscope() -> None:
    assert [axes.get_title() for axes in dark().axes] == ["channel 1", "channel 3"]
    for figure in (ranges(), repeats(), contrast()):
        assert [axes.get_ylabel() for axes in figure.axes] == ["channel 1\n(mV)", "channel 3\n(mV)"]
        assert figure.axes[1].get_xlabel() == "time after the trigger (ns)"


def test_what_should_be_used_of_a_range_is_stated() -> None:
    assert "grey: 60% of it" in ranges().get_suptitle()


def test_the_first_light_is_stated() -> None:
    assert "first light, 98.0016 ns" in legend(delay())


def test_a_half_width_that_is_not_known_is_not_marked() -> None:
    assert len(scan().axes[0].lines) == len(scan(None).axes[0].lines) + 1


def test_the_digitisers_levels_make_no_comb() -> None:
    """Every bin holds equally many of the levels, wherever the bins would fall."""
    codes = np.repeat(np.arange(-33, 34), 12)
    [axes] = dark_figure(1e-4 * codes[np.newaxis, np.newaxis] * np.ones((2, 1, 1)), [1]).axes
    heights = [patch.get_height() for patch in axes.patches]  # type: ignore[attr-defined]
    assert len(set(heights[:-1])) == 1
