"""A run as one task among others: what it leaves behind."""

import gc
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from platform import node

import pytest

from labctl.bench.station import SIMULATED_STATION
from labctl.engine.session import Acquisition
from labctl.errors import RunError, RunInUse, WrongPlace
from labctl.runs.format.layout import RunPaths
from labctl.runs.index import run_row
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.events import EventReader
from labctl.runs.write.placing import put_whole
from labctl.runs.write.writer import RunWriter
from labctl.studies.run_tasks import acquire_run
from labctl.studies.tasks import CALLER, Caller, Interrupted
from protocols.image_readout import ImageReadout
from sim_backends.world.twin import Twin

FEW = ImageReadout(images=8, window=0.4e-9)


class Alone:
    """Waits for the run, and wants nothing of it."""

    scratch: Path | None = None

    def stopped(self) -> bool:
        return False

    def measured(self, records: int) -> None:
        pass


class OnASmallDisk(Alone):
    """Has the run measured in a folder where a file, from its first record on, takes no more than some bytes."""

    def __init__(self, scratch: Path) -> None:
        self.scratch = scratch

    def measured(self, records: int) -> None:
        import resource

        resource.setrlimit(resource.RLIMIT_FSIZE, (100, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


class Slower(Alone):
    """Has the run measured in a folder, while somebody else puts one into its place."""

    def __init__(self, scratch: Path, other: Path, place: Path) -> None:
        self.scratch, self.other, self.place = scratch, other, place

    def measured(self, records: int) -> None:
        put_whole(self.other, self.place)


class Impatient(Alone):
    """Wants the run to end after its first record."""

    begun = False

    def stopped(self) -> bool:
        return self.begun

    def measured(self, records: int) -> None:
        self.begun = True


class Pausing(Alone):
    """Has the run pause after its first record, and wants it to end when it waits."""

    def __init__(self, run: Path) -> None:
        self.run, self.asked = run, 0

    def stopped(self) -> bool:
        self.asked += 1
        return self.asked > 1

    def measured(self, records: int) -> None:
        ask(self.run, Word.PAUSE)


class OnAWorker(Alone):
    """Gives the same task to others, one of which writes the run until it is asked whether it should stop."""

    def __init__(self, scratch: Path, writer: RunWriter) -> None:
        self.scratch, self.writer = scratch, writer

    def stopped(self) -> bool:
        self.writer.abandon()
        return False


@contextmanager
def waiting(caller: Caller) -> Iterator[None]:
    token = CALLER.set(caller)
    try:
        yield
    finally:
        CALLER.reset(token)


def acquisition(directory: Path, protocol: ImageReadout = FEW) -> Acquisition:
    return Acquisition(protocol, SIMULATED_STATION, directory)


def begin(directory: Path) -> None:
    """A run that lacks most of its records."""
    with waiting(Impatient()), pytest.raises(Interrupted):
        acquire_run(acquisition(directory))
    assert not run_row(RunPaths(directory)).complete


def test_a_run_that_has_begun_in_its_place_is_gone_on_with(tmp_path: Path) -> None:
    begin(tmp_path / "run")
    with waiting(Alone()):
        assert acquire_run(acquisition(tmp_path / "run")).complete
        assert acquire_run(acquisition(tmp_path / "run")).measured == 0


def test_a_paused_run_hears_that_it_should_end(tmp_path: Path) -> None:
    with waiting(Pausing(tmp_path / "run")), pytest.raises(Interrupted):
        acquire_run(acquisition(tmp_path / "run"))
    assert "paused" in [event.name for event in EventReader(RunPaths(tmp_path / "run").events).read()]


def test_a_run_that_begins_while_its_sweep_is_paused_waits_in_the_dark(tmp_path: Path) -> None:
    ask(tmp_path, Word.PAUSE)
    impatient = Impatient()
    impatient.begun = True
    with waiting(impatient), pytest.raises(Interrupted):
        acquire_run(acquisition(tmp_path / "run"))
    assert run_row(RunPaths(tmp_path / "run")).shots == 0
    assert "emission" not in [event.name for event in EventReader(RunPaths(tmp_path / "run").events).read()]


def test_another_run_that_has_begun_there_is_refused(tmp_path: Path) -> None:
    begin(tmp_path / "run")
    with (
        waiting(Alone()),
        pytest.raises(RunError, match=r"another run is there \(protocol.settings.images is 8, not 9\)"),
    ):
        acquire_run(acquisition(tmp_path / "run", FEW.model_copy(update={"images": 9})))


def test_another_run_that_is_put_there_meanwhile_is_refused_and_this_one_kept(tmp_path: Path) -> None:
    place, other, scratch = tmp_path / "store" / "run", tmp_path / "other", tmp_path / "scratch"
    with waiting(Alone()):
        acquire_run(acquisition(other, FEW.model_copy(update={"images": 9})))
    with (
        waiting(Slower(scratch, other, place)),
        pytest.raises(WrongPlace, match=r"another run is there \(protocol.settings.images is 9, not 8\)") as raised,
    ):
        acquire_run(acquisition(place))
    (kept,) = scratch.glob("*/run")
    assert raised.value.__notes__ == [f"the run is kept on {node()} in {kept}"]
    assert run_row(RunPaths(kept)).complete
    assert run_row(RunPaths(place)).planned == run_row(RunPaths(other)).planned


def test_the_same_run_that_is_put_there_meanwhile_is_taken(tmp_path: Path) -> None:
    place, other, scratch = tmp_path / "store" / "run", tmp_path / "other", tmp_path / "scratch"
    with waiting(Alone()):
        acquire_run(acquisition(other))
    with waiting(Slower(scratch, other, place)):
        assert acquire_run(acquisition(place)).directory == place
    assert list(scratch.iterdir()) == []


def test_a_run_that_a_lost_worker_is_still_writing_is_waited_for(tmp_path: Path) -> None:
    begin(tmp_path / "run")
    with waiting(OnAWorker(tmp_path, RunWriter.resume(tmp_path / "run"))):
        assert acquire_run(acquisition(tmp_path / "run")).complete


def test_of_one_that_finds_no_room_on_a_worker_nothing_is_kept_and_it_says_so(tmp_path: Path) -> None:
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    try:
        with waiting(OnASmallDisk(tmp_path / "scratch")), pytest.raises(RunError) as raised:
            acquire_run(acquisition(tmp_path / "run"))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert re.fullmatch(
        rf"{tmp_path}/scratch/run\..*: cannot be written: File too large, on {node()}; nothing of this run is kept: "
        r"files may be larger after .*, then begin it anew",
        str(raised.value),
    )
    assert list((tmp_path / "scratch").iterdir()) == []
    assert not (tmp_path / "run").exists()


def test_one_that_somebody_here_is_writing_is_refused(tmp_path: Path) -> None:
    begin(tmp_path / "run")
    writer = RunWriter.resume(tmp_path / "run")
    with waiting(Alone()), pytest.raises(RunInUse):
        acquire_run(acquisition(tmp_path / "run"))
    writer.abandon()


def test_the_simulated_bench_is_gone_when_its_run_is_over(tmp_path: Path) -> None:
    gc.collect()
    others = {id(found) for found in gc.get_objects() if type(found) is Twin}
    gc.disable()
    try:
        with waiting(Alone()):
            acquire_run(acquisition(tmp_path / "run"))
        left = [found for found in gc.get_objects() if type(found) is Twin and id(found) not in others]
    finally:
        gc.enable()
    assert not left
