from pathlib import Path

from matplotlib.figure import Figure

from labctl.reports.figures.roc import RocCurve, roc_figure
from tests.labctl.reports.figures.drawn import check_figure, legend


def roc() -> Figure:
    best = RocCurve("covariance", [0, 0, 0.1, 1], [0, 0.9, 1, 1], 0.995, 0.002)
    other = RocCurve("dark pixels", [0, 0.2, 1], [0, 0.9, 1], 0.95)
    return roc_figure([best, other], paper=0.978)


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(roc, tmp_path)


def test_a_roc_states_its_area() -> None:
    figure = roc()
    assert legend(figure) == ["covariance: AUC 0.995 ± 0.002", "dark pixels: AUC 0.950", "guessing: AUC 0.500"]
    assert figure.legends[0].get_title().get_text() == "paper: AUC 0.978"
    assert figure.axes[1].get_xlim() == (0, 20)
