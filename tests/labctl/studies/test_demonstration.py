"""The demonstration at a small size: the same path, fewer images and twins."""

from pathlib import Path

import pytest

from labctl.bench.signals import Interruption
from labctl.studies.demonstration import WINDOWS_NS, demonstrate, paper_says, passed
from protocols.image_readout import ImageReadout


def test_two_twins_from_images_to_report(tmp_path: Path) -> None:
    seen: list[int] = []
    result = demonstrate(
        tmp_path,
        interruption=Interruption(),
        progress=lambda done, _total: seen.append(done),
        protocol=ImageReadout(images=80),
        twin_seeds=(1, 2),
    )
    assert result is not None
    assert list(result["accuracy"]) == [f"{window}" for window in WINDOWS_NS]
    assert list(result["accuracy_without_reservoir"]) == list(result["accuracy"])
    assert all(0.25 < reached["mean"] <= 1 for reached in result["accuracy"].values())
    assert (result["shots"], result["twins"], len(result["runs"])) == (80, 2, 4)
    assert Path(result["run"], "data.h5").is_file()
    assert "chip bypassed" in Path(result["report"]).read_text()
    assert seen == sorted(seen)


def test_interrupted_it_has_no_result(tmp_path: Path) -> None:
    interruption = Interruption(requested=True)
    result = demonstrate(
        tmp_path,
        interruption=interruption,
        progress=lambda _done, _total: None,
        protocol=ImageReadout(images=80),
        twin_seeds=(1,),
    )
    assert result is None


@pytest.mark.parametrize(
    ("at_04", "at_1", "without", "verdict"),
    [(0.90, 0.94, 0.80, True), (0.89, 0.94, 0.80, False), (0.9, 0.93, 0.8, False), (0.9, 0.94, 0.85, False)],
)
def test_every_requirement_counts(at_04: float, at_1: float, without: float, verdict: bool) -> None:
    accuracy = {key: {"mean": value, "sd": 0.0} for key, value in (("0.4", at_04), ("0.56", 0.92), ("1.0", at_1))}
    assert passed(accuracy, {"0.56": {"mean": without, "sd": 0.0}}) is verdict


def test_what_the_paper_says() -> None:
    assert (paper_says("0.32"), paper_says("0.4")) == ("< 0.90", "> 0.90")
