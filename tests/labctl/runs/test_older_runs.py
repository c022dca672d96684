"""Runs and readouts that labctl wrote in format 1.1 open, verify, resume and export as they did then."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from labctl.runs.export import Content, write
from labctl.runs.format.journal import read_journal
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.studies.readout_file import load_metadata, load_model
from tests.command_line import as_json

OLDER = Path(__file__).parent / "older" / "1.1"
DIGESTS = {
    "complete": "3069ba28ee4b1c1dd0e121fd8a8779c074be2d36158bd62f2831fbce50d6c8a1",
    "scenes": "0f93303c5b0038daf118d889be797c355ab254a0e847b5b4e8dc08b6670233ac",
}
"""Of the frames, by the labctl that measured them."""


@pytest.mark.parametrize("name", DIGESTS)
def test_a_complete_run_opens_verifies_and_exports(name: str, tmp_path: Path) -> None:
    report = verify_run(OLDER / name)
    assert report.intact
    assert report.complete
    assert report.data_file == "current"
    with open_run(OLDER / name) as run:
        assert run.digest() == DIGESTS[name]
        assert write(Content.of(run, None, "volts"), "npz", tmp_path / "run.npz")
        with np.load(tmp_path / "run.npz") as exported:
            np.testing.assert_allclose(exported["volts"], run.volts())
            assert exported["next_label"].tolist() == run.shots["next_label"].tolist()


@pytest.mark.parametrize("name", DIGESTS)
def test_its_shards_alone_say_the_same(name: str, tmp_path: Path) -> None:
    shutil.copytree(OLDER / name, tmp_path / "run")
    (tmp_path / "run" / "data.h5").unlink()
    with open_run(tmp_path / "run") as run:
        assert run.digest() == DIGESTS[name]
    assert verify_run(tmp_path / "run", rebuild=True).data_file == "current"
    with open_run(tmp_path / "run" / "data.h5") as run:
        assert run.digest() == DIGESTS[name]


def test_a_killed_run_keeps_what_it_has_where_the_bench_is_another(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """It can be resumed, but for its reference image: that of the simulated bench of then was another."""
    shutil.copytree(OLDER / "killed", tmp_path / "run")
    before = read_journal(tmp_path / "run" / "journal.jsonl").entries
    status, resumed = as_json(capsys, "resume", tmp_path / "run")
    assert status == 1
    assert "is not what it was: its traces differ by" in resumed["error"]
    assert read_journal(tmp_path / "run" / "journal.jsonl").entries[: len(before)] == before
    assert verify_run(tmp_path / "run").intact


def test_a_readout_reads_as_it_did() -> None:
    assert load_metadata(OLDER / "readout.h5")["accuracy"] == 0.75
    assert load_model(OLDER / "readout.h5").predict(np.zeros((1, 5, 10))).shape == (1,)
