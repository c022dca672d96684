"""The demonstration at a small size: the same path, fewer images and twins."""

from pathlib import Path
from typing import Any

import pytest

from labctl.bench.signals import Interruption
from labctl.studies.demonstration import demonstrate, paper_says
from labctl.studies.paper.experiments import Experiment, experiments

WINDOWS = ["0.08", "0.16", "0.24", "0.32", "0.4", "0.56", "0.8", "1.0", "2.0"]


def small(twins: int) -> Experiment:
    """The demonstration with 80 images, one trigger each."""
    (whole,) = experiments(["demonstration"])
    runs: dict[str, Any] = {name: run.model_dump() for name, run in whole.runs.items()}
    for run in runs.values():
        run["settings"] |= {"images": 80, "averages": 1}
    return Experiment.model_validate(whole.model_dump() | {"runs": runs, "twins": twins})


def test_two_twins_from_images_to_report(tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    result = demonstrate(
        small(twins=2),
        tmp_path,
        interruption=Interruption(),
        progress=lambda done, total: seen.append((done, total)),
    )
    assert result is not None
    assert list(result["accuracy"]) == list(result["accuracy_without_reservoir"]) == WINDOWS
    assert all(0.25 < reached["mean"] <= 1 for reached in result["accuracy"].values())
    assert (result["experiment"], result["shots"], result["twins"], len(result["runs"])) == ("fig3", 80, 2, 4)
    assert [Path(run).name.partition("-twin-")[2] for run in result["runs"]] == ["1", "2", "1-bypass", "2-bypass"]
    assert result["run"] == result["runs"][0]
    assert Path(result["run"], "data.h5").is_file()
    assert "chip bypassed" in Path(result["report"]).read_text()
    assert seen == sorted(seen)
    assert seen[-1] == (2 * 88 * 3, 2 * 88 * 3)


def test_interrupted_it_has_no_result(tmp_path: Path) -> None:
    interruption = Interruption(requested=True)
    assert demonstrate(small(twins=1), tmp_path, interruption=interruption, progress=lambda *_: None) is None


@pytest.mark.parametrize(
    ("at_04", "at_1", "without", "verdict"),
    [(0.90, 0.94, 0.80, True), (0.89, 0.94, 0.80, False), (0.9, 0.93, 0.8, False), (0.9, 0.94, 0.85, False)],
)
def test_every_requirement_counts(at_04: float, at_1: float, without: float, verdict: bool) -> None:
    here = {"accuracy": {"0.4": at_04, "0.56": 0.92, "1.0": at_1}, "accuracy_without_reservoir": {"0.56": without}}
    (demonstration,) = experiments(["demonstration"])
    assert all(must.reached(here) for must in demonstration.must) is verdict


def test_what_the_paper_says() -> None:
    assert (paper_says("0.32"), paper_says("0.4")) == ("< 0.90", "> 0.90")


def test_it_is_carried_out_by_its_name_only() -> None:
    assert "demonstration" not in [experiment.name for experiment in experiments()]
