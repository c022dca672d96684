"""What a run shows of its last shots while it measures, to whoever looks, and to nobody else."""

from pathlib import Path

import numpy as np
import pytest

from instruments.values import Frames, Scaling
from labctl.bench.station import Station
from labctl.engine.glimpses import EVERY_S, MOST_BYTES, PATIENCE_S, Glimpses
from labctl.engine.session import Acquisition, acquire
from labctl.runs.live.glimpse import GLIMPSE, read_glimpse
from labctl.runs.live.sight import LOOKED, RECENT, look_at
from labctl.runs.read.follower import Follower, Stretch
from labctl.runs.read.run import open_run
from protocols.image_readout import ImageReadout
from tests import observers
from tests.labctl.engine.conftest import Clock

SCALINGS = (Scaling(1e-3, 0.0), Scaling(2e-3, 0.1))


def frames(first: int, count: int = 1, samples: int = 5) -> Frames:
    codes = np.broadcast_to(
        np.arange(first, first + count, dtype=np.int8)[:, np.newaxis, np.newaxis], (count, 2, samples)
    )
    return Frames(
        codes,
        np.zeros((count, 2)),
        np.linspace(0.5 * first, 0.5 * (first + count - 1), count),
        np.zeros((count, 2), np.bool_),
    )


def test_the_last_shots_of_the_pass_are_shown_as_often_as_a_page_draws(tmp_path: Path, clock: Clock) -> None:
    glimpses = Glimpses(tmp_path, clock)
    for shot in range(40):
        glimpses.take(0, shot, frames(shot), SCALINGS)
        clock.now += EVERY_S / 4
    seen = read_glimpse(tmp_path)
    assert seen is not None
    assert seen.shots.tolist() == list(range(37 - RECENT, 37)), "the 38th to 40th came too soon after it"
    assert seen.codes[:, 0, 0].tolist() == seen.shots.tolist()
    assert seen.time_s.tolist() == [shot / 2 for shot in seen.shots]
    assert (seen.scale_v.tolist(), seen.offset_v.tolist()) == ([1e-3, 2e-3], [0.0, 0.1])
    glimpses.take(1, 7, frames(7), SCALINGS)
    seen = read_glimpse(tmp_path)
    assert seen is not None
    assert (seen.pass_index, seen.shots.tolist()) == (1, [7])
    glimpses.close()
    assert read_glimpse(tmp_path) is None


def test_of_shots_that_come_together_the_last_ones_are_shown(tmp_path: Path, clock: Clock) -> None:
    Glimpses(tmp_path, clock).take(0, 20, frames(20, 100), SCALINGS)
    seen = read_glimpse(tmp_path)
    assert seen is not None
    assert seen.shots.tolist() == list(range(120 - RECENT, 120))
    assert seen.codes[:, 1, 2].tolist() == seen.shots.tolist()


def test_when_nobody_looks_any_more_nothing_is_left_until_somebody_does_again(tmp_path: Path, clock: Clock) -> None:
    glimpses = Glimpses(tmp_path, clock)
    look_at(tmp_path)
    glimpses.take(0, 0, frames(0), SCALINGS)
    assert read_glimpse(tmp_path) is not None
    clock.now = PATIENCE_S
    glimpses.take(0, 1, frames(1), SCALINGS)
    assert not list(tmp_path.iterdir())
    look_at(tmp_path)
    clock.now += EVERY_S
    glimpses.take(0, 2, frames(2), SCALINGS)
    seen = read_glimpse(tmp_path)
    assert seen is not None
    assert seen.shots.tolist() == [2]


def test_a_run_that_nobody_looks_at_shows_nothing(tmp_path: Path) -> None:
    directory, seen = tmp_path / "run", list[Path]()

    def look(_done: int, _total: int) -> None:
        seen.extend(path for path in directory.iterdir() if path.name == GLIMPSE)

    protocol = ImageReadout(images=8, window=0.8e-9, ports=(2,))
    acquire(Acquisition(protocol, Station(), directory), observer=observers.Follower(progress=look))
    assert not seen


@pytest.mark.parametrize(("samples", "shown"), [(MOST_BYTES // 6, 3), (MOST_BYTES, 0)])
def test_long_records_are_shown_in_part_or_not_at_all(tmp_path: Path, clock: Clock, samples: int, shown: int) -> None:
    glimpses = Glimpses(tmp_path, clock)
    for shot in range(5):
        clock.now += EVERY_S
        glimpses.take(0, shot, frames(shot, samples=samples), SCALINGS)
    seen = read_glimpse(tmp_path)
    assert (0 if seen is None else len(seen.shots)) == shown


def test_a_folder_that_is_gone_is_no_reason_to_end_a_run(tmp_path: Path, clock: Clock) -> None:
    glimpses = Glimpses(tmp_path / "gone", clock)
    glimpses.take(0, 0, frames(0), SCALINGS)
    glimpses.close()


def test_a_run_is_seen_shot_by_shot_before_its_shards_are_closed(tmp_path: Path) -> None:
    directory = tmp_path / "run"
    following, seen = list[Follower](), list[Stretch]()

    def look(_done: int, _total: int) -> None:
        look_at(directory)
        if not following:
            following.append(Follower(directory))
        if (glimpse := following[0].glimpse()) is not None:
            seen.append(glimpse)

    protocol = ImageReadout(images=300, window=0.8e-9, ports=(2, 3))
    acquire(Acquisition(protocol, Station(), directory), observer=observers.Follower(progress=look))
    assert seen
    assert not {GLIMPSE, LOOKED} & {path.name for path in directory.iterdir()}, "it is over"
    with open_run(directory) as run:
        for glimpse in seen:
            assert np.array_equal(glimpse.codes, run.frames[glimpse.shots])
            assert np.allclose(glimpse.time_s, run.shots["time_s"][glimpse.shots])
            assert glimpse.ports == run.ports
