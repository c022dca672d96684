"""The channels of a run, seen from what it has on disk."""

from pathlib import Path

import numpy as np

from labctl.bench.station import Station
from labctl.dashboard.run_sight import RunSight, spread
from labctl.engine.session import Acquisition, acquire
from labctl.runs.live.sight import RECENT
from labctl.runs.read.run import open_run
from protocols.image_readout import ImageReadout
from tests.observers import Follower


def test_a_run_is_seen_while_it_measures_and_its_references_tell_of_drift(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    sight = RunSight(directory)
    seen = []

    def look(_done: int, _total: int) -> None:
        sight.look()
        if sight.sight is not None:
            seen.append(sight.sight)

    protocol = ImageReadout(images=60, window=0.8e-9, reference_every=5, ports=(2, 3))
    acquire(Acquisition(protocol, Station(), directory), observer=Follower(progress=look))
    look(0, 0)
    assert len({found.looks for found in seen}) > 2
    last = seen[-1]
    with open_run(directory) as run:
        kinds = run.shots["kind"]
        lit, references = (np.flatnonzero(found) for found in (kinds != "dark", kinds == "reference"))
        assert np.array_equal(last.recent, run.frames[lit[-RECENT:]])
        assert last.looks == lit.size
        assert last.repeats is not None
        assert np.array_equal(last.repeats, run.frames[references[-RECENT:]])
        assert np.allclose(last.level_v, run.volts(references).mean(axis=2))
        assert np.allclose(last.peak_v, run.volts(lit).mean(axis=2).max(axis=0))
    assert last.elapsed_s[0] == 0
    assert (last.likeness > 0.8).all()


def test_what_is_no_run_shows_nothing(tmp_path: Path) -> None:
    sight = RunSight(tmp_path / "nothing")
    sight.look()
    assert sight.sight is None


def test_of_many_some_are_read_from_the_first_to_the_last() -> None:
    assert spread(range(1000), 3) == [0, 500, 999]
