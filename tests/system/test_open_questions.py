"""`labctl check --deep --arm`: what documents leave open is measured, kept, and told before a run where it differs."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.answers import warnings
from labctl.bench.station import read_station

pytestmark = pytest.mark.usefixtures("one_core")

Labctl = Callable[..., tuple[int, dict[str, Any]]]

STATION = """
[wiring]
burst = true
[sim.parameters]
mirror_leaves_s = 2e-6
mirror_arrives_s = 6e-6
"""


def test_a_bench_answers_and_later_runs_are_warned(labctl: Labctl, tmp_path: Path) -> None:
    station = tmp_path / "station.toml"
    station.write_text(STATION)
    status, result = labctl("check", "--station", str(station), "--deep", "--arm")
    answers = {one["question"]: one for one in result["answers"]}
    assert status == 0
    assert {one["agrees"] for one in answers.values()} == {True}
    low, high = (
        float(word)
        for word in answers["levels at which the drive's marker triggers the oscilloscope"]["found"].split()[0:3:2]
    )
    assert [low, high] == pytest.approx([0.0, 1.0], abs=0.03)  # the marker's levels
    rest = answers["mirrors at rest after their command"]["found"]
    assert float(rest.split()[0]) == pytest.approx(6.0, abs=0.5)

    kept = Path(result["kept_in"])
    content = json.loads(kept.read_text())
    content["answers"][0] |= {"found": "1000 points", "agrees": False}
    kept.write_text(json.dumps(content))
    (warning,) = warnings(read_station(station))
    assert "shortest record of a single trigger: 1000 points, not 500 points" in warning


def test_light_is_not_asked_for_in_vain(labctl: Labctl) -> None:
    status, result = labctl("check", "--arm")
    assert status == 2
    assert "--deep" in result["error"]
