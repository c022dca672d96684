"""What a result rests on: one parameter of the twin at a time, the defaults measured once for all of them."""

from pathlib import Path

import numpy as np
import pytest

from labctl.analysis.intervals import pooled
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION, Station, read_station, write_addresses
from labctl.errors import ExperimentError, StationError
from labctl.studies.paper.experiments import Experiment, experiments
from labctl.studies.paper.reproduction import Plan
from labctl.studies.paper.sensitivity import Dependence, as_json, figure_of, in_words, sensitivity, study_of

pytestmark = pytest.mark.usefixtures("one_core")

FILE = """
title = "Few images"
paper = ""
statement = ""
analysis = "recognition"
splits = 2
[runs.chip]
protocol = "image-readout"
settings = { images = 40, ports = "2,3", window = "2 ns" }
[sensitivity]
run = "chip"
window = "0.4 ns"
twins = 1
[[sensitivity.parameters]]
name = "effective bits"
parameter = "enob"
values = [3.5, 5.5]
default = 5.5
[[sensitivity.parameters]]
name = "detector bandwidth (GHz)"
parameter = "detector_bandwidth_hz"
values = [3.0, 12.0]
unit = 1e9
default = 12.0
[[sensitivity.parameters]]
name = "drive depth (rad)"
parameter = "rf_gain"
values = [3.14, 6.28]
unit = 2.833
default = 6.28
"""


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    (tmp_path / "few.toml").write_text(FILE, encoding="utf-8")
    (found,) = experiments(folder=tmp_path)
    return found


def test_the_defaults_are_measured_once(experiment: Experiment, tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    found = sensitivity(
        Plan((experiment,), SIMULATED_STATION, tmp_path / "out"),
        experiment,
        interruption=Interruption(),
        progress=lambda done, total: seen.append((done, total)),
    )
    runs = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert runs == ["seed-1", "seed-1-detector_bandwidth_hz-3e+09", "seed-1-enob-3.5", "seed-1-rf_gain-8.89562"]
    assert seen[-1] == (4, 4)
    shown = as_json(found)
    assert shown["enob"]["accuracy"][1] == shown["detector_bandwidth_hz"]["accuracy"][1]
    assert all(0 <= accuracy["mean"] <= 1 for one in shown.values() for accuracy in one["accuracy"])
    assert figure_of(study_of(experiment), found).stem == "sensitivity"


def test_a_drive_is_as_deep_as_its_driver_that_saturates_makes_it(experiment: Experiment) -> None:
    *_, gain = study_of(experiment).parameters
    shown = in_words(gain, SIMULATED_STATION)
    assert shown.values == pytest.approx([4 * np.pi * np.tanh(value * 2.833 / 32) for value in gain.values], abs=0.005)
    assert [*shown.values, shown.default] == pytest.approx([3.41, 6.35, 6.35], abs=0.01)
    assert in_words(study_of(experiment).parameters[0], SIMULATED_STATION) == study_of(experiment).parameters[0]


def test_a_real_bench_has_nothing_to_vary(experiment: Experiment, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    write_addresses(path, dict.fromkeys(Station().addresses, "TCPIP0::192.0.2.1::5000::SOCKET"))
    plan = Plan((experiment,), read_station(path), tmp_path / "out")
    with pytest.raises(ExperimentError, match="a real bench has no parameters to vary: leave --station out"):
        sensitivity(plan, experiment, interruption=Interruption(), progress=lambda *_: None)


def test_a_value_that_cannot_be_is_refused_before_anything_is_measured(tmp_path: Path) -> None:
    (tmp_path / "few.toml").write_text(
        FILE.replace("values = [3.5, 5.5]", "values = [2.5, 5.5, 99.0]"), encoding="utf-8"
    )
    (experiment,) = experiments(folder=tmp_path)
    plan = Plan((experiment,), SIMULATED_STATION, tmp_path / "out")
    with pytest.raises(StationError, match="enob"):
        sensitivity(plan, experiment, interruption=Interruption(), progress=lambda *_: None)
    assert not (tmp_path / "out").exists()


def test_a_value_whose_light_the_bench_refuses_is_left_out_of_the_figure(experiment: Experiment) -> None:
    variation, *_ = study_of(experiment).parameters
    found = [Dependence(variation, [None, pooled([[0.8, 0.9]])])]
    assert as_json(found)["enob"]["accuracy"][0] is None
    (axes, *_) = figure_of(study_of(experiment), found).figure.axes
    assert [np.asarray(line.get_xdata()).tolist() for line in axes.lines if line.get_marker() == "o"] == [[5.5]]
