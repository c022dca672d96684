"""What the guide promises of an experiment's file, and on how many benches an experiment is measured."""

import re
from pathlib import Path

import pytest

from labctl.bench.station import SIMULATED_STATION, Station, WiringSection, read_station, write_addresses
from labctl.studies.paper.analyses import MODULES, analysis_of
from labctl.studies.paper.experiments import Experiment, experiments
from labctl.studies.paper.feasibility import check
from labctl.studies.paper.reproduction import Plan

GUIDE = Path(__file__).parents[4] / "docs" / "how-to" / "run-the-experiments-on-your-bench.md"


@pytest.fixture
def eleventh(tmp_path: Path) -> Experiment:
    """The experiment that the guide writes."""
    found = re.search(r"```toml\n(.*?)```", GUIDE.read_text("utf-8"), re.DOTALL)
    assert found is not None
    (tmp_path / "one-port.toml").write_text(found[1], encoding="utf-8")
    (experiment,) = experiments(folder=tmp_path)
    return experiment


def test_the_file_in_the_guide_is_an_experiment(eleventh: Experiment, tmp_path: Path) -> None:
    analysis_of(eleventh)
    assert eleventh.name == "one-port"
    assert check(Plan((eleventh,), SIMULATED_STATION, tmp_path / "out")) == {}
    assert not (tmp_path / "out").exists()


def test_the_guide_knows_every_experiment_and_every_analysis() -> None:
    text = GUIDE.read_text("utf-8")
    for name in (*(experiment.name for experiment in experiments()), *MODULES):
        assert f"`{name}`" in text


def test_a_seed_is_a_bench_only_where_every_seed_has_a_twin(eleventh: Experiment, tmp_path: Path) -> None:
    path = tmp_path / "served.toml"
    write_addresses(path, dict.fromkeys(Station().addresses, "TCPIP0::192.0.2.1::5000::SOCKET"))
    for station, benches in ((SIMULATED_STATION, 5), (read_station(path), 1)):
        plan = Plan((eleventh,), station, tmp_path / "out")
        assert plan.seeds_of(eleventh) == (1, 2, 3, 4, 5)
        assert plan.benches_of(eleventh) == benches


def test_a_simulated_bench_is_cabled_as_needed_unless_its_file_says_how(tmp_path: Path) -> None:
    (series,) = experiments(["s2"])
    (protocol,) = series.protocols.values()
    plan = Plan((series,), Station(), tmp_path)
    assert not plan.station_for(protocol, 1).wiring.projector
    said = Plan((series,), Station(wiring=WiringSection(projector=True)), tmp_path)
    assert said.station_for(protocol, 1).wiring.projector
