from pathlib import Path

from matplotlib.figure import Figure

from labctl.reports.canvas import Level
from labctl.reports.figures.bars import Bar, Bars, bars_figure
from tests.labctl.reports.figures.drawn import beside, check_files, legend


def bars() -> Figure:
    values = [Bar("network", 0.181, 0.005), Bar("linear", 0.153, float("nan"))]
    return bars_figure([Bars("MNIST", values, [Level("paper", 0.219)]), Bars("Fashion", values)])


def test_it_is_sound(tmp_path: Path) -> None:
    check_files(bars, tmp_path)


def test_bars_print_their_values() -> None:
    figure = bars()
    assert beside(figure.axes[0]) == ["0.181 ± 0.005", "0.153"]
    assert legend(figure) == ["paper 0.219"]
    assert figure.axes[1].get_xlabel() == "RMSE of pixels (0 to 1), mean ± sd"
