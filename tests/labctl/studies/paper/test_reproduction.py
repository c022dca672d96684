"""What the guide promises of an experiment's file, and on how many benches an experiment is measured."""

import re
from pathlib import Path

import pytest

from labctl.bench.station import (
    SIMULATED_STATION,
    SimSection,
    Station,
    WiringSection,
    read_station,
    write_addresses,
)
from labctl.studies.paper.analyses import MODULES, analysis_of
from labctl.studies.paper.experiments import Experiment, experiments
from labctl.studies.paper.feasibility import check
from labctl.studies.paper.reproduction import Plan, name_by_settings
from labctl.studies.paper.twin_runs import TwinRuns
from tests.checkout import ROOT

GUIDE = ROOT / "docs" / "how-to" / "run-the-experiments-on-your-bench.md"


@pytest.fixture
def eleventh(tmp_path: Path) -> Experiment:
    """The experiment that the guide writes."""
    found = re.search(r"```toml\n(title = .*?)```", GUIDE.read_text("utf-8"), re.DOTALL)
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


class TestColumns:
    """Single triggers first, the mean of several beside them."""

    def test_still_images_come_in_bursts_where_the_station_is_wired(self, eleventh: Experiment, tmp_path: Path) -> None:
        for station, timing in ((SIMULATED_STATION, "burst"), (Station(), "software")):
            single, averaged = Plan((eleventh,), station, tmp_path).columns_of(eleventh, 7)
            assert single["chip"].model_dump() | {"averages": 16} == averaged["chip"].model_dump()
            assert single["chip"].model_dump()["timing"] == timing
            assert (single["chip"].averages, single["chip"].seed) == (1, 7)

    def test_a_file_that_says_how_frames_are_timed_is_heeded(self, eleventh: Experiment, tmp_path: Path) -> None:
        runs = {"chip": {"protocol": "image-readout", "settings": {"timing": "software"}}}
        said = Experiment.model_validate(eleventh.model_dump() | {"runs": runs})
        single, _ = Plan((said,), SIMULATED_STATION, tmp_path).columns_of(said, 1)
        assert single["chip"].model_dump()["timing"] == "software"

    def test_without_averages_the_runs_settings_hold(self, eleventh: Experiment, tmp_path: Path) -> None:
        runs = {"chip": {"protocol": "image-readout", "settings": {"averages": 4}}}
        must = [{"what": "accuracy", "path": ["one_port", "2.0"], "at_least": 0.8}]
        own = Experiment.model_validate(eleventh.model_dump() | {"runs": runs, "averages": (), "must": must})
        (only,) = Plan((own,), SIMULATED_STATION, tmp_path).columns_of(own, 1)
        assert only["chip"].averages == 4

    def test_what_needs_no_light_is_found_once_for_both(self) -> None:
        known: dict[str, int] = {}
        columns = [TwinRuns({}, {}, 1, 1, known=known) for _ in range(2)]
        asked: list[int] = []

        def compute() -> int:
            asked.append(1)
            return 5

        assert [column.once("raw pixels", compute) for column in columns] == [5, 5]
        assert len(asked) == 1


def test_seeds_begin_where_they_are_told(eleventh: Experiment, tmp_path: Path) -> None:
    assert Plan((eleventh,), SIMULATED_STATION, tmp_path, first_seed=3, seeds=2).seeds_of(eleventh) == (3, 4)
    assert Plan((eleventh,), SIMULATED_STATION, tmp_path, quick=True, first_seed=3).seeds_of(eleventh) == (3,)


class TestParametersOfARun:
    """A run of an experiment beyond the paper on a twin that differs from the station's."""

    @pytest.fixture
    def two_runs(self, eleventh: Experiment) -> Experiment:
        chip = eleventh.runs["chip"]
        changed = chip.model_copy(update={"parameters": {"enob": 4.0}})
        return eleventh.model_copy(update={"series": "beyond", "runs": {"chip": chip, "changed": changed}})

    def test_they_are_those_of_its_twin_beside_the_stations_own(self, two_runs: Experiment, tmp_path: Path) -> None:
        station = Station(sim=SimSection(parameters={"enob": 5.0, "rf_gain": 10.0}))
        plan = Plan((two_runs,), station, tmp_path)
        protocol = two_runs.protocols["changed"]
        changed = plan.acquisition(protocol, tmp_path / "a", two_runs.runs["changed"].parameters)
        assert changed.station.sim.parameters == {"enob": 4.0, "rf_gain": 10.0}
        assert plan.acquisition(protocol, tmp_path / "b").station.sim == station.sim

    def test_a_run_on_another_twin_is_another_run(self, two_runs: Experiment) -> None:
        protocol = two_runs.protocols["chip"]
        assert name_by_settings("", protocol, {}) != name_by_settings("", protocol, {"enob": 4.0})

    def test_a_parameter_that_there_is_not_is_one_line(self, two_runs: Experiment, tmp_path: Path) -> None:
        wrong = two_runs.runs["chip"].model_copy(update={"parameters": {"enbo": 4.0}})
        experiment = two_runs.model_copy(update={"runs": {"chip": wrong}})
        (problem,) = check(Plan((experiment,), SIMULATED_STATION, tmp_path / "out")).values()
        assert "enbo" in str(problem)
        assert "\n" not in str(problem)

    def test_a_bench_that_is_not_simulated_has_none(self, two_runs: Experiment, tmp_path: Path) -> None:
        path = tmp_path / "served.toml"
        write_addresses(path, dict.fromkeys(Station().addresses, "TCPIP0::192.0.2.1::5000::SOCKET"))
        changed = two_runs.model_copy(update={"runs": {"chip": two_runs.runs["changed"]}})
        (problem,) = check(Plan((changed,), read_station(path), tmp_path / "out")).values()
        assert "served.toml: enob is changed for a run, and only a wholly simulated bench" in str(problem)
        assert "\n" not in str(problem)


def test_a_simulated_bench_is_cabled_as_needed_unless_its_file_says_how(tmp_path: Path) -> None:
    (series,) = experiments(["s2"])
    (protocol,) = series.protocols.values()
    plan = Plan((series,), Station(), tmp_path)
    assert not plan.station_for(protocol, 1).wiring.projector
    said = Plan((series,), Station(wiring=WiringSection(projector=True)), tmp_path)
    assert said.station_for(protocol, 1).wiring.projector
