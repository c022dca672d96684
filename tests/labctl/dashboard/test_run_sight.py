"""The channels of a run, seen from what it has on disk."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from instruments.values import Scaling
from labctl.bench.station import Station
from labctl.dashboard.run_sight import RunSight, spread
from labctl.engine.glimpses import Glimpses
from labctl.engine.session import Acquisition, acquire
from labctl.runs.live.sight import RECENT
from labctl.runs.read.run import open_run
from labctl.runs.write.writer import RunWriter, Timer
from protocols.image_readout import ImageReadout
from tests.labctl.runs.conftest import SMALL, measure, plan_for
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
        assert last.looks == len(kinds)
        assert last.repeats is not None
        assert np.array_equal(last.repeats, run.frames[references[-RECENT:]])
        assert np.allclose(last.level_v, run.volts(references).mean(axis=2))
        assert np.allclose(last.peak_v, run.volts(lit).mean(axis=2).max(axis=0))
    assert last.elapsed_s[0] == 0
    assert (last.likeness > 0.8).all()


class Wall:
    """A clock that is put forward by hand, with what is due meanwhile."""

    def __init__(self) -> None:
        self._now_s = 0.0
        self._due: dict[int, tuple[float, Callable[[], None]]] = {}

    def clock(self) -> float:
        return self._now_s

    def timer(self, seconds: float, call: Callable[[], None]) -> Timer:
        return Due(self._due, self._now_s + seconds, call)

    def pass_by(self, seconds: float) -> None:
        self._now_s += seconds
        for key, (at_s, call) in list(self._due.items()):
            if at_s <= self._now_s:
                del self._due[key]
                call()


class Due:
    """A timer of such a clock."""

    def __init__(self, due: dict[int, tuple[float, Callable[[], None]]], at_s: float, call: Callable[[], None]) -> None:
        self._due, self._at_s, self._call = due, at_s, call

    def start(self) -> None:
        self._due[id(self)] = self._at_s, self._call

    def cancel(self) -> None:
        self._due.pop(id(self), None)


def test_the_newest_shot_of_a_slow_run_is_seen_long_before_the_next_one_comes(tmp_path: Path) -> None:
    wall, plan = Wall(), plan_for(SMALL)
    sight, seen = RunSight(tmp_path), list[Any]()
    with RunWriter.create(tmp_path, {}, SMALL, plan, timer=wall.timer, clock=wall.clock) as writer:
        writer.scales(0, 1e-3, 0)
        for shot in range(SMALL.shots):
            writer.append(0, shot, measure(SMALL, 0, shot))
            wall.pass_by(0.1)
            sight.look()
            seen.append(None if sight.sight is None else sight.sight.recent[-1])
            wall.pass_by(2.9)
    assert seen[0] is None, "it may be the first of many that come fast"
    lit = np.flatnonzero(plan["kind"] != b"dark")[1:]
    assert all(np.array_equal(seen[shot], measure(SMALL, 0, shot).codes[0]) for shot in lit)


def test_while_the_run_shows_its_last_shots_these_are_seen_and_its_shards_when_it_does_not(tmp_path: Path) -> None:
    plan, sight = plan_for(SMALL), RunSight(tmp_path)
    wall = Wall()
    with RunWriter.create(tmp_path, {}, SMALL, plan, timer=wall.timer, clock=wall.clock) as writer:
        writer.scales(0, 1e-3, 0)
        show = Glimpses(tmp_path)
        sight.look()
        assert sight.sight is None
        lit = np.flatnonzero(plan["kind"] != b"dark")
        shots = range(int(lit[2]) + 1)
        for shot in shots:
            writer.append(0, shot, measure(SMALL, 0, shot))
        show.take(0, shots[-1], measure(SMALL, 0, shots[-1]), [Scaling(1e-3, 0.0)] * len(SMALL.passes[0]))
        sight.look()
        assert sight.sight is not None
        assert np.array_equal(sight.sight.recent, measure(SMALL, 0, shots[-1]).codes)
        assert sight.sight.looks == len(shots)
        assert not sight.sight.elapsed_s.size, "nothing is on disk"
        show.close()
        writer.sync()
        sight.look()
        assert np.array_equal(sight.sight.recent, np.concatenate([measure(SMALL, 0, one).codes for one in lit[:3]]))


def test_what_a_killed_process_left_is_not_seen(tmp_path: Path) -> None:
    with RunWriter.create(tmp_path, {}, SMALL, plan_for(SMALL)) as writer:
        Glimpses(tmp_path).take(0, 1, measure(SMALL, 0, 1), [Scaling(1e-3, 0.0)] * len(SMALL.passes[0]))
        sight = RunSight(tmp_path)
        sight.look()
        assert sight.sight is None
        Glimpses(tmp_path).take(0, 2, measure(SMALL, 0, 2), [Scaling(1e-3, 0.0)] * len(SMALL.passes[0]))
        sight.look()
        assert sight.sight is not None
        writer.sync()


def test_what_is_no_run_shows_nothing(tmp_path: Path) -> None:
    sight = RunSight(tmp_path / "nothing")
    sight.look()
    assert sight.sight is None


def test_of_many_some_are_read_from_the_first_to_the_last() -> None:
    assert spread(range(1000), 3) == [0, 500, 999]
