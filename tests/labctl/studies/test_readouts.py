"""What is made of readouts of runs."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from labctl.analysis.windows import WindowFeatures
from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition, acquire
from labctl.errors import AnalysisError
from labctl.runs.read.run import open_run
from labctl.studies import readout_training
from labctl.studies.readout_evaluation import evaluate_readout
from labctl.studies.readout_file import load_metadata, load_model, save_model
from labctl.studies.readout_training import file_name, train_readout
from protocols.image_readout import ImageReadout


def measured(directory: Path, **settings: Any) -> Path:
    """A run of 0.4 ns of the simulated bench."""
    protocol = ImageReadout.model_validate({"images": 80, "window": 0.4e-9} | settings)
    acquire(Acquisition(protocol, SIMULATED_STATION, directory))
    return directory


def trained(run: Path, ports: tuple[int, ...] | None = None) -> Path:
    """A readout of a run, beside it."""
    return Path(train_readout(run, window_s=0.4e-9, ports=ports, seed=1, out=run.with_suffix(".h5"))["model"])


def drawn(run: Path) -> str:
    """The figure of the accuracy."""
    return (run / "figures" / "accuracy.svg").read_text(encoding="utf-8")


def own_set(path: Path, *, classes: int) -> Path:
    """Random images of 8 x 8, 20 of each class."""
    images = np.random.default_rng(classes).random((20 * classes, 8, 8)) < 0.5
    np.savez(path, images=images, labels=np.arange(len(images)) % classes)
    return path


def as_earlier(model: Path) -> None:
    """Make it one of an earlier version, which does not say at which wavelength each entry of its records was."""
    metadata = load_metadata(model)
    del metadata["masks"]["columns"]
    save_model(model, load_model(model), metadata)


def test_a_readout_sees_the_ports_it_was_trained_on_wherever_they_are_in_a_run(tmp_path: Path) -> None:
    model = trained(measured(tmp_path / "trained", ports="2-6"))
    others = measured(tmp_path / "others", ports="7,6,5,4,3,2", image_seed=9)
    found = evaluate_readout(model, others)
    assert found["accuracy"] > 0.6
    assert "images on ports 2, 3, 4, 5, 6; softmax" in Path(found["report"]).read_text(encoding="utf-8")
    assert found["controls"]["shuffled labels"]["at_chance"]

    missing = measured(tmp_path / "missing", ports="3-7", image_seed=9)
    told = r"was trained on port 2 at 1550 nm, which this run does not hold: measure it, or train anew"
    with pytest.raises(AnalysisError, match=told):
        evaluate_readout(model, missing)
    as_earlier(model)
    with pytest.raises(AnalysisError, match=r"was trained on ports 2, 3, 4, 5, 6, and this run is of 3, 4, 5, 6, 7: "):
        evaluate_readout(model, missing)


def test_ports_that_a_readout_does_not_see_may_be_missing(tmp_path: Path) -> None:
    run = measured(tmp_path / "trained", ports="2-6")
    fewer = measured(tmp_path / "fewer", ports="2-4", image_seed=9)
    assert evaluate_readout(trained(run, ports=(4, 3, 2)), fewer)["accuracy"] > 0.5
    with pytest.raises(AnalysisError, match="was trained on port 5 at 1550 nm"):
        evaluate_readout(trained(run), fewer)


def test_records_may_be_longer_or_shorter_as_long_as_they_hold_the_window(tmp_path: Path) -> None:
    short, long = (measured(tmp_path / name, ports="2-6", window=1e-9 * float(name)) for name in ("0.4", "1"))
    others = {
        name: measured(tmp_path / f"other {name}", window=1e-9 * float(name), image_seed=9) for name in ("0.4", "1")
    }
    assert evaluate_readout(trained(long), others["0.4"])["accuracy"] > 0.6
    assert evaluate_readout(trained(short), others["1"])["accuracy"] > 0.6
    whole = Path(train_readout(long, window_s=1e-9, ports=None, seed=1, out=tmp_path / "whole.h5")["model"])
    with pytest.raises(AnalysisError) as raised:
        evaluate_readout(whole, others["0.4"])
    assert str(raised.value) == (
        f"{whole}: cannot work on {others['0.4']}: its window needs 1 ns records, and these have 0.4 ns: record "
        "longer, or train anew"
    )


def test_a_readout_knows_its_wavelengths_in_any_order(tmp_path: Path) -> None:
    model = trained(measured(tmp_path / "trained", ports="2-4", wavelengths=(1550.0, 1551.0)))
    turned = measured(tmp_path / "turned", ports="2-4", wavelengths=(1551.0, 1550.0), image_seed=9)
    found = evaluate_readout(model, turned)
    assert found["accuracy"] > 0.6
    assert "images on ports 2, 3, 4; softmax" in Path(found["report"]).read_text(encoding="utf-8")
    as_earlier(model)
    assert evaluate_readout(model, tmp_path / "trained")["accuracy"] == load_metadata(model)["accuracy"]


def test_the_compressive_ratio_is_of_the_samples_that_a_readout_sees(tmp_path: Path) -> None:
    run = measured(tmp_path / "run", images=40)
    model = train_readout(run, window_s=0.4e-9, tau_s=80e-12, ports=None, seed=1, out=None)["model"]
    evaluate_readout(Path(model), run)
    assert ">0.64<" in drawn(run), "five samples of 784 pixels at 0.4 ns"
    assert ">1.28<" not in drawn(run)


def test_what_the_paper_says_is_drawn_over_what_it_is_said_of(tmp_path: Path) -> None:
    cases: list[tuple[dict[str, Any], bool]] = [
        ({}, True),
        ({"classes": (0, 1)}, False),
        ({"dataset": str(own_set(tmp_path / "own.npz", classes=4))}, False),
    ]
    for number, (settings, said) in enumerate(cases):
        run = measured(tmp_path / f"run-{number}", images=40, ports="2-4", **settings)
        evaluate_readout(trained(run), run)
        assert ("paper: " in drawn(run)) is said


def test_controls_do_not_depend_on_how_many_images_memory_holds(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = measured(tmp_path / "run", images=120, ports="2", reference_every=3)
    model = trained(run)
    full = evaluate_readout(model, run)
    monkeypatch.setattr(readout_training, "MOST_NUMBERS", 60 * 10)
    found = evaluate_readout(model, run)
    assert (full["left_out"], found["left_out"]) == (0, 60)
    for name in ("fixed image", "dark"):
        assert found["controls"][name] == full["controls"][name] is not None


def test_references_beyond_what_memory_holds_are_left_out_of_their_control(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = measured(tmp_path / "run", images=60, ports="2", reference_every=1)
    monkeypatch.setattr(readout_training, "MOST_NUMBERS", 40 * 10)
    with open_run(run) as opened:
        records, left_out = readout_training.bounded_records(opened, "reference")
    assert (records.labels.size, left_out) == (40, 20)
    assert evaluate_readout(trained(run), run)["controls"]["fixed image"]["at_chance"]


def test_want_of_memory_is_not_the_fault_of_a_readout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run = measured(tmp_path / "run", ports="2")
    model = trained(run)

    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(WindowFeatures, "transform", full)
    with pytest.raises(MemoryError):
        evaluate_readout(model, run)


def test_a_readout_is_called_by_its_ports_at_however_many_wavelengths() -> None:
    usual = "softmax-0.4ns-ports-2-3-4-5-6.h5"
    assert file_name(0.4e-9, None, 1.0, (2, 3, 4, 5, 6)) == usual
    assert file_name(0.4e-9, None, 1.0, (2, 3, 4, 5, 6) * 50) == usual, "no file system takes 500 characters"
    assert file_name(1e-9, 80e-12, 0.1, (2,)) == "softmax-1.0ns-every-80ps-C-0.1-ports-2.h5"
