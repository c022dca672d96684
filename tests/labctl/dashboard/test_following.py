"""The readout that follows a run while somebody watches: the same whenever it is asked, and of what can be learnt."""

from pathlib import Path
from shutil import copytree

import numpy as np
import pytest

from labctl.analysis.online import OnlineClassifier
from labctl.bench.station import Station
from labctl.dashboard.accuracy import LEAST
from labctl.dashboard.following import BLOCK, Following, follow
from labctl.engine.session import Acquisition, acquire
from labctl.runs.format.layout import RunPaths
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run
from protocols.image_readout import ImageReadout


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("runs") / "run"
    acquire(Acquisition(ImageReadout(images=LEAST + 2 * BLOCK, window=0.4e-9, ports=(2, 3)), Station(), directory))
    return directory


def followed(directory: Path, known: Following) -> Following:
    follows = True
    while follows:
        known, follows = follow(directory, known)
    return known


def test_each_image_is_predicted_before_it_is_learnt(run: Path) -> None:
    found = followed(run, Following())
    with open_run(run) as stored:
        records = read_records(stored)
    features = records.traces.reshape(records.labels.size, -1)
    readout = OnlineClassifier().partial_fit(features[:LEAST], records.labels[:LEAST])
    expected = readout.follow(features[LEAST:], records.labels[LEAST:]) == records.labels[LEAST:]
    np.testing.assert_array_equal(found.right, expected)
    images, reached = found.points
    assert images.tolist() == [LEAST + BLOCK, LEAST + 2 * BLOCK]
    assert reached.tolist() == [expected[:BLOCK].mean(), expected[BLOCK:].mean()]
    assert found.ports == (2, 3)


def test_a_run_watched_as_it_grows_says_what_one_says_that_was_not(run: Path, tmp_path: Path) -> None:
    """Its journal is let grow line by line; each time only what is new is learnt."""
    growing = copytree(run, tmp_path / "run")
    RunPaths(growing).data.unlink()
    journal = RunPaths(growing).journal
    lines = journal.read_bytes().splitlines(keepends=True)
    assert len(lines) > 3
    journal.write_bytes(b"")
    known, before = Following(), -1
    for line in lines:
        with journal.open("ab") as file:
            file.write(line)
        known = followed(growing, known)
        assert known.right.size >= before
        before = known.right.size
    whole = followed(run, Following())
    np.testing.assert_array_equal(known.right, whole.right)
    assert follow(growing, known) == (known, False), "nothing is new"


def test_more_ports_are_followed_from_the_beginning(run: Path) -> None:
    other_ports = Following(ports=(7,), right=np.ones(9, np.bool_), next_shot=50, readout=OnlineClassifier())
    np.testing.assert_array_equal(followed(run, other_ports).right, followed(run, Following()).right)


def test_what_nothing_can_be_learnt_from_is_not_followed(tmp_path: Path) -> None:
    nothing = Following()
    assert follow(tmp_path / "nothing", nothing) == (nothing, False)
    one_class = ImageReadout(images=LEAST + 5, classes=(1,), window=0.08e-9, ports=(2,))
    acquire(Acquisition(one_class, Station(), tmp_path / "run"))
    assert follow(tmp_path / "run", nothing) == (nothing, False)
