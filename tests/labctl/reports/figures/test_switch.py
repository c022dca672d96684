from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from labctl.reports.figures.switch import envelope, switch_figure
from tests.labctl.reports.figures.drawn import check_figure, legend

CLASSES = ('"0"', '"1"', '"2"')


def switch() -> Figure:
    time_s = np.arange(17_000) * 0.56e-9
    share = 1 / (1 + np.exp(-(time_s - 5e-6) / 0.1e-6))
    probabilities = np.stack([0 * share, 1 - share, share], axis=1)
    return switch_figure(
        time_s,
        {'"1"': 1 - share / 2, '"2"': 0.5 + share / 2},
        probabilities,
        CLASSES,
        transit_s=(4.5e-6, 5.5e-6),
        switch_s=5.0e-6,
    )


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(switch, tmp_path)


def test_a_class_looks_the_same_in_both_panels() -> None:
    figure = switch()
    correlation, probability = figure.axes
    looks = {str(line.get_label()): (line.get_color(), line.get_marker()) for line in probability.lines}
    for line in correlation.lines:
        assert looks[str(line.get_label())] == (line.get_color(), line.get_marker())
    assert legend(figure) == ["mirrors move", "new class stays", *CLASSES]
    assert probability.get_xlabel() == "time (µs)"
    assert "switch seen at 5.00 µs" in correlation.get_title(loc="left")
    assert all(len(np.asarray(line.get_xdata())) <= 600 for axes in figure.axes for line in axes.lines)


def test_a_switch_that_is_never_seen_is_not_marked() -> None:
    figure = switch_figure(
        [0.0, 1e-6], {'"1"': [1, 0.5]}, np.eye(2), ('"1"', '"2"'), transit_s=(0.4e-6, 0.6e-6), switch_s=None
    )
    assert legend(figure) == ["mirrors move", '"1"', '"2"']


def test_an_envelope_holds_all_values() -> None:
    values = np.random.default_rng(0).normal(size=10_007)
    middle, low, median, high = envelope(np.arange(values.size), values, stretches=100)
    assert middle.size == 100
    assert (low.min(), high.max()) == (values.min(), values.max())
    assert np.all((low <= median) & (median <= high))
    short = envelope([0, 1], [3, 4], stretches=100)
    np.testing.assert_array_equal(short, [[0, 1], [3, 4], [3, 4], [3, 4]])
