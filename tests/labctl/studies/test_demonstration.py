"""The demonstration at a small size: the same path, fewer images and twins."""

from pathlib import Path
from typing import Any

from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION
from labctl.studies.demonstration import demonstrate, paper_says
from labctl.studies.paper.experiments import Experiment, experiments
from labctl.studies.paper.reproduction import Plan

WINDOWS = ["0.08", "0.16", "0.24", "0.32", "0.4", "0.56", "0.8", "1.0", "2.0"]


def small(twins: int) -> Experiment:
    """The demonstration with 80 images."""
    (whole,) = experiments(["demonstration"])
    runs: dict[str, Any] = {name: run.model_dump() for name, run in whole.runs.items()}
    for run in runs.values():
        run["settings"] |= {"images": 80}
    return Experiment.model_validate(whole.model_dump() | {"runs": runs, "twins": twins})


def test_two_twins_from_images_to_report(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    result = demonstrate(
        Plan((small(twins=2),), SIMULATED_STATION, tmp_path, first_seed=3),
        interruption=Interruption(),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert result is not None
    assert list(result["accuracy"]) == list(result["accuracy_without_reservoir"]) == WINDOWS
    for column in (result, result["averaged"]):
        assert all(0.25 < reached["mean"] <= 1 for reached in column["accuracy"].values())
        assert all(reached["low"] <= reached["mean"] <= reached["high"] for reached in column["accuracy"].values())
    assert (result["experiment"], result["shots"], result["twins"], len(result["runs"])) == ("fig3", 80, 2, 8)
    names = ["3", "4", "3-bypass", "4-bypass"]
    twins = [Path(run).name.partition("-twin-")[2] for run in result["runs"]]
    assert twins == names + [f"{name}-averaged" for name in names]
    assert result["run"] == result["runs"][0]
    assert Path(result["run"], "data.h5").is_file()
    page = Path(result["report"]).read_text()
    assert "chip bypassed, single triggers" in page
    assert "2 simulated benches (seeds 3 to 4)" in page
    assert seen == sorted(seen)
    assert seen[-1] == (2 * 2 * 88 * 3, 2 * 2 * 88 * 3)


def test_interrupted_it_has_no_result(tmp_path: Path) -> None:
    interruption = Interruption(requested=True)
    plan = Plan((small(twins=1),), SIMULATED_STATION, tmp_path)
    assert demonstrate(plan, interruption=interruption, progress=lambda *_: None) is None


def test_what_the_paper_says() -> None:
    assert (paper_says("0.32"), paper_says("0.4")) == ("< 0.90", "> 0.90")


def test_it_is_carried_out_by_its_name_only() -> None:
    assert "demonstration" not in [experiment.name for experiment in experiments()]
