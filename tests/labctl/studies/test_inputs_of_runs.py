"""Images are the same by what they come from, however their set is called: in tests of readouts and beside others."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from labctl.studies.comparison import compare
from labctl.studies.inputs_of_runs import source_of
from labctl.studies.readout_evaluation import evaluate_readout
from labctl.studies.readout_training import train_readout
from protocols.image_readout import ImageReadout

Measured = Callable[[str, int], Path]


@pytest.fixture
def measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Measured:
    """A run of the set of that name, in the folder of the test."""
    monkeypatch.chdir(tmp_path)

    def run(dataset: str, order: int) -> Path:
        directory = tmp_path / f"run-{order}"
        protocol = ImageReadout(
            dataset=dataset, images=40, ports="2", window=0.4e-9, order_seed=order, reference_every=20
        )
        acquire(Acquisition(protocol, SIMULATED_STATION, directory))
        return directory

    return run


def write(path: Path, seed: int) -> None:
    """Images that nothing can be learnt of."""
    images = np.random.default_rng(seed).random((40, 8, 8)) < 0.5
    path.parent.mkdir(exist_ok=True)
    np.savez(path, images=images, labels=np.arange(40) % 4)


def test_a_set_by_another_name_is_no_other_set(measured: Measured, tmp_path: Path) -> None:
    write(tmp_path / "mine.npz", 1)
    write(tmp_path / "other" / "mine.npz", 2)
    first = measured("mine.npz", 1)
    model = Path(train_readout(first, window_s=0.4e-9, ports=None, seed=1, out=None)["model"])
    unseen = evaluate_readout(model, first)["test_shots"]
    again = measured(str(tmp_path / "mine.npz"), 2)
    assert evaluate_readout(model, again)["test_shots"] == unseen
    os.chdir(tmp_path / "other")
    others = measured("mine.npz", 3)
    assert evaluate_readout(model, others)["test_shots"] == 40

    assert compare(first, again).same_image is not None
    found = compare(first, others)
    assert found.same_image is None
    assert "inputs_source" in [one.setting for one in found.differences]


def test_a_part_of_a_set_has_its_images() -> None:
    def known_by(**manifest: Any) -> str | None:
        return source_of(manifest)

    part = known_by(protocol={"settings": {"dataset": "mnist-0-3"}})
    assert part == known_by(protocol={"settings": {"dataset": "mnist"}}) == known_by(inputs_source="mnist")
    assert known_by(protocol={"settings": {"dataset": "mine.npz"}}) == "mine.npz", "as runs of earlier versions say"
    assert known_by(inputs_source="") is known_by(protocol=[]) is None
