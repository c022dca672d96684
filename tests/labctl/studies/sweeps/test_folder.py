"""A sweep under way that is told to stop or wait, whenever that comes: nothing is lit thereafter."""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from instruments.bench import Observer
from labctl.bench.opening import Access
from labctl.bench.signals import Interruption, StoppedBySignal
from labctl.bench.station import SIMULATED_STATION
from labctl.errors import RunError, WrongPlace
from labctl.runs.asking import tell
from labctl.runs.format.layout import RunPaths
from labctl.runs.live.control_file import Word
from labctl.runs.live.events import EventReader
from labctl.runs.live.owner import writer_of
from labctl.runs.sweep import Sweep, places
from labctl.runs.verification import verify_run
from labctl.studies.processes import processes
from labctl.studies.sweeps import folder
from labctl.studies.sweeps.declaration import Point, points
from labctl.studies.tasks import Workers
from protocols.image_readout import ImageReadout

ASKED = Sweep(
    protocol="image-readout",
    settings={"images": 4, "window": "0.4 ns", "ports": "2"},
    over={"power": ("10 mW", "20 mW", "30 mW")},
    reference_every=0,
)
FIRST, SECOND, THIRD = (name for name, _ in places(ASKED))


class When(Observer):
    """Does something at the first event of that name of a run."""

    def __init__(self, event: str, act: Callable[[], object]) -> None:
        self._event, self._act = event, act

    def event(self, name: str, **_fields: Any) -> None:
        if name == self._event:
            self._event = ""
            self._act()


def carried_out(
    directory: Path,
    *,
    before: str = "",
    at: tuple[str, str] = ("", ""),
    act: Callable[[], object],
    interruption: Interruption | None = None,
) -> folder.Measured:
    """A sweep in which something is done before a run begins, or at an event of a run."""

    @contextmanager
    def follow(_number: int, _count: int, point: Point) -> Iterator[Observer]:
        if point.name == before:
            act()
        yield When(at[1], act) if point.name == at[0] else Observer()

    every = points(ASKED, ImageReadout, SIMULATED_STATION)
    if not directory.exists():
        folder.begin(directory, ASKED, ImageReadout, SIMULATED_STATION)
    heard = interruption or Interruption()
    return folder.carry_out(directory, every, data=None, access=Access(), interruption=heard, follow=follow)


def lit(run: Path) -> bool:
    return any(event.name == "emission" and event.fields["on"] for event in EventReader(RunPaths(run).events).read())


@pytest.mark.parametrize("asked", ["", FIRST])
def test_stop_while_a_run_is_finished_begins_no_other(asked: str, tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"
    found = carried_out(sweep, at=(FIRST, "finished"), act=lambda: tell(sweep / asked, Word.STOP))
    assert (found.complete, found.measured) == (1, 1)
    assert not (sweep / SECOND).exists()


def test_stop_between_two_runs_lights_nothing(tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"
    found = carried_out(sweep, before=SECOND, act=lambda: tell(sweep, Word.STOP))
    assert found.complete == 1
    assert not lit(sweep / SECOND)
    assert not (sweep / THIRD).exists()
    assert carried_out(sweep, act=lambda: None).complete == 3, "a word of an earlier time means nothing"
    assert sorted(one.name for one in sweep.iterdir()) == [FIRST, SECOND, THIRD, "events.jsonl", "owner", "sweep.json"]


def test_stop_as_soon_as_a_run_can_be_found_lights_nothing(tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"
    found = carried_out(sweep, at=(SECOND, "run started"), act=lambda: tell(sweep, Word.STOP))
    assert found.complete == 1
    assert not lit(sweep / SECOND)


def test_stop_is_heard_by_the_run_under_way_after_the_clock_was_set_back(tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"

    def stop() -> None:
        now = RunPaths(sweep / SECOND).events.stat().st_mtime
        os.utime(RunPaths(sweep / FIRST).events, (now + 7200, now + 7200))
        tell(sweep, Word.STOP)

    assert carried_out(sweep, at=(SECOND, "pass started"), act=stop).complete == 1
    assert not (sweep / THIRD).exists()


def test_stop_now_between_two_runs_ends_at_once(tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"
    with pytest.raises(StoppedBySignal):
        carried_out(sweep, before=SECOND, act=lambda: tell(sweep, Word.STOP_NOW))
    assert not lit(sweep / SECOND)


def test_pause_and_go_on_of_the_folder_are_those_of_its_runs(tmp_path: Path) -> None:
    sweep, waited = tmp_path / "sweep", list[list[str]]()

    def wait(_seconds: float) -> None:
        waited.append([event.name for event in EventReader(RunPaths(sweep / FIRST).events).read()])
        tell(sweep, Word.GO_ON)

    found = carried_out(
        sweep,
        at=(FIRST, "pass started"),
        act=lambda: tell(sweep, Word.PAUSE),
        interruption=Interruption(wait=wait),
    )
    assert found.complete == 3
    [[*_, dark, told]] = waited
    assert (dark, told) == ("safe state", "paused")


def test_a_run_that_lost_a_shard_is_not_complete(tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"
    assert carried_out(sweep, act=lambda: None).complete == 3
    lost = RunPaths(sweep / SECOND).shard(0)
    lost.unlink()
    found = carried_out(sweep, act=lambda: None)
    assert (found.complete, found.measured) == (3, 0), "its records are in data.h5"
    assert lost.exists()
    assert verify_run(sweep / SECOND).intact


def test_workers_that_share_no_folder_are_told_not_an_interruption(tmp_path: Path) -> None:
    sweep = tmp_path / "sweep"
    folder.begin(sweep, ASKED, ImageReadout, SIMULATED_STATION)

    @contextmanager
    def elsewhere(tasks: int) -> Iterator[Workers]:
        with processes(tasks) as workers:
            yield workers
        (tmp_path / "another machine").mkdir()
        for name in (FIRST, SECOND, THIRD):
            (sweep / name).rename(tmp_path / "another machine" / name)

    with pytest.raises(WrongPlace, match=rf"^{sweep}/00\d-.*: was measured, and is not there on .*: the workers share"):
        folder.carry_out_side_by_side(
            sweep,
            points(ASKED, ImageReadout, SIMULATED_STATION),
            engine=elsewhere,
            data=None,
            access=Access(),
            interruption=Interruption(),
            progress=lambda *_: None,
        )


def test_a_sweep_has_one_process_which_can_be_found(tmp_path: Path) -> None:
    sweep, refused = tmp_path / "sweep", list[str]()

    def again() -> None:
        assert writer_of(RunPaths(sweep)) is not None
        with pytest.raises(RunError) as raised:
            carried_out(sweep, act=lambda: None)
        refused.append(str(raised.value))

    assert carried_out(sweep, before=SECOND, act=again).complete == 3
    assert refused == [f"{sweep}: another process carries this sweep out: wait for its end, or stop it"]
    assert writer_of(RunPaths(sweep)) is None
