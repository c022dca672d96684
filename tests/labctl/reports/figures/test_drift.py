from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from labctl.reports.figures.drift import drift_figure
from tests.labctl.reports.figures.drawn import check_figure, legend, noise

PORTS = ("port 2", "port 3")


def drift(seconds: float = 100.0) -> Figure:
    return drift_figure(seconds * np.sort(noise(9, 2), axis=0), 0.05 * noise(9, 2), 1 - noise(9, 2), ports=PORTS)


def test_it_is_sound(tmp_path: Path) -> None:
    check_figure(drift, tmp_path)


@pytest.mark.parametrize(("seconds", "unit"), [(1e5, "h"), (1e3, "min"), (100.0, "s"), (0.1, "ms"), (1e-4, "ms")])
def test_time_is_in_a_unit_that_reads_well(seconds: float, unit: str) -> None:
    figure = drift(seconds)
    assert figure.axes[1].get_xlabel() == f"time since the run began ({unit})"
    assert figure.axes[0].get_ylabel() == "mean signal (mV)"
    assert legend(figure) == list(PORTS)
