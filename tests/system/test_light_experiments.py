"""The experiments on how little light will do, b3 and b4, by the command: small, from the sockets to figures."""

import json
import tomllib
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from labctl.commands.main import main
from labctl.studies.paper.experiments import FOLDER, experiments
from tests.system.test_every_experiment import write

pytestmark = pytest.mark.usefixtures("one_core")

LEVELS = ["attenuated-25", "attenuated-10"]


def smaller(name: str) -> dict[str, Any]:
    """An experiment's file with few images, and two levels of light where it has many."""
    content = tomllib.loads((FOLDER / f"{name}.toml").read_text("utf-8"))
    if "levels" in content["settings"]:
        content["settings"]["levels"] = LEVELS
        content["runs"] = {run: planned for run, planned in content["runs"].items() if run in (*LEVELS, "bright")}
    for planned in content["runs"].values():
        planned["settings"]["images"] = 160
    return content


def test_they_go_from_their_files_to_figures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "experiments"
    for name in ("b3", "b4"):
        write(folder, name, smaller(name))
    monkeypatch.setattr("labctl.commands.reproduce.experiments", partial(experiments, folder=folder))

    with pytest.raises(SystemExit):
        main(["reproduce", "b3", "b4", "--quick", "--json", "--out", str(tmp_path / "out")])
    whole = json.loads((tmp_path / "out" / "report.json").read_text("utf-8"))
    few, analogue = whole["experiments"]
    dim, bright = (few["here"]["photons"][level]["mean"] for level in LEVELS)
    assert 20 < bright / dim < 50, "15 dB apart"
    assert few["here"]["ideal"]["2.0"]["0.1"]["mean"] < few["here"]["ideal"]["2.0"]["300"]["mean"]
    assert analogue["here"]["counted_loss"]["10"]["mean"] > 0
    noise = {one["here"]["bright_noise_photons"]["mean"] for one in (few, analogue)}
    assert len(noise) == 1
    assert noise.pop() > 100_000, "ten times what b4 asks for"
    drawn = {path.name for path in (tmp_path / "out" / "figures").glob("*.svg")}
    assert drawn == {"b3-photons.svg", "b4-bits.svg", "b4-photons.svg"}
    assert len(list((tmp_path / "out").glob("image-readout-*"))) == 4, "b3 and b4 have one bright run"
