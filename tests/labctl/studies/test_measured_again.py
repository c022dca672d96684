"""Shots of an earlier pass that are measured again come last in time, whatever their place in the plan."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from labctl.analysis.evaluation import validate
from labctl.analysis.splits import forward_in_time_split
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from labctl.studies.readout_evaluation import evaluate_readout
from labctl.studies.readout_file import load_model
from labctl.studies.readout_training import train_readout
from tests.command_line import answer

AGAIN = slice(5, 10)
"""Shots of the shard that was damaged."""


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of two passes, of which the first was measured again in part."""
    folder = tmp_path_factory.mktemp("measured")
    station, directory = folder / "bench.toml", folder / "run"
    station.write_text("[durability]\nshots = 5\nseconds = 60.0\n", encoding="utf-8")
    words = ("--set", "images=60", "--set", "ports=2,3,4,5,6", "--set", "window=0.4 ns", "--station", station)
    assert answer("run", "image-readout", *words, "--out", directory, "--json")[0] == 0
    shard = directory / "shards" / "000001.h5"
    shard.write_bytes(shard.read_bytes()[:-1] + b"?")
    (directory / "data.h5").unlink()  # from which it would be made again
    assert answer("resume", directory, "--json")[1]["measured"] == 5
    return directory


def test_a_shot_has_time_and_epoch_of_the_pass_that_was_measured_last(run: Path) -> None:
    with open_run(run) as opened:
        shots, measured, epochs = opened.shots, opened.measured_at_s, opened.epoch
    assert (measured[AGAIN, 0] > measured[:, 1].max()).all()
    assert np.array_equal(shots["time_s"], measured.max(axis=1))
    assert np.array_equal(shots["epoch"], np.take_along_axis(epochs, measured.argmax(axis=1)[:, None], 1)[:, 0])
    with h5py.File(run / "data.h5") as file:
        assert np.array_equal(file["shots"]["time_s"], shots["time_s"])


def test_forward_in_time_follows_the_clock(run: Path) -> None:
    model = Path(train_readout(run, window_s=0.4e-9, ports=None, seed=1, out=None)["model"])
    with open_run(run) as opened:
        records = read_records(opened)
    split = forward_in_time_split(records.groups, order=records.time_s)
    assert records.time_s[split[0]].max() < records.time_s[split[1]].min()
    assert set(np.arange(100)[AGAIN]) & set(records.indices[split[1]].tolist())
    features = load_model(model)[0].transform(records.traces)
    expected = float(validate(features, records.labels, [split]).scores[0])
    assert evaluate_readout(model, run)["forward_in_time"] == expected
