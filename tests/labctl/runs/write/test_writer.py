import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from instruments.values import Frames
from labctl.errors import RunError, RunExists, RunInUse
from labctl.runs.format.columns import ShotFlag
from labctl.runs.format.journal import NOT_COMPARED, held
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.durability import Durability
from labctl.runs.write.writer import RunWriter, wall_timer

Begin = Callable[..., RunWriter]
Measure = Callable[[RunShape, int, int], Frames]
Finish = Callable[..., None]
Whole = Callable[..., Path]


class HandTimer:
    """A timer that fires when the test says so."""

    def __init__(self, seconds: float, call: Callable[[], None]) -> None:
        self.seconds, self.fire = seconds, call
        self.running = False

    def start(self) -> None:
        self.running = True

    def cancel(self) -> None:
        self.running = False


class HandTimers(list[HandTimer]):
    def __call__(self, seconds: float, call: Callable[[], None]) -> HandTimer:
        self.append(HandTimer(seconds, call))
        return self[-1]


def journal(directory: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (directory / "journal.jsonl").read_text().splitlines()]


shapes = st.builds(
    RunShape,
    shots=st.integers(1, 12),
    passes=st.lists(st.integers(0, 14), min_size=1, max_size=5, unique=True).flatmap(
        lambda ports: st.integers(0, len(ports) - 1).map(
            lambda cut: (tuple(ports),) if cut == 0 else (tuple(ports[:cut]), tuple(ports[cut:]))
        )
    ),
    samples=st.integers(1, 40),
    sample_interval_s=st.just(20e-12),
    code_type=st.sampled_from(["int8", "int16"]),
)


@settings(max_examples=40, deadline=None)
@given(shape=shapes, shots=st.integers(1, 6))
def test_what_is_written_is_read(
    write_whole: Whole, measure: Measure, plan_for: Callable[[RunShape], NDArray[Any]], shape: RunShape, shots: int
) -> None:
    with TemporaryDirectory() as folder, open_run(write_whole(Path(folder) / "run", shape, shots)) as run:
        expected = [[measure(shape, p, shot) for shot in range(shape.shots)] for p in range(len(shape.passes))]
        codes = np.concatenate([np.concatenate([m.codes for m in measured]) for measured in expected], axis=1)
        clipped = np.concatenate([np.concatenate([m.clipped for m in measured]) for measured in expected], axis=1)
        offsets = np.concatenate(
            [np.concatenate([m.trigger_offset_s for m in measured]) for measured in expected], axis=1
        )
        np.testing.assert_array_equal(run.frames[:], codes)
        np.testing.assert_array_equal(run.clipped, clipped)
        np.testing.assert_array_equal(run.trigger_offset_s, offsets)
        np.testing.assert_array_equal(run.epoch, np.tile(np.arange(len(shape.passes)) + 1, (shape.shots, 1)))
        np.testing.assert_array_equal(
            run.measured_at_s, np.array([[m.time_s[0] for m in measured] for measured in expected]).T
        )
        plan = plan_for(shape)
        for name in ("dataset_index", "label", "wavelength_nm", "group"):
            np.testing.assert_array_equal(run.shots[name], plan[name])
        assert run.shots["kind"].tolist() == [kind.decode() for kind in plan["kind"]]
        np.testing.assert_array_equal(run.shots["flags"], np.where(clipped.any(axis=1), ShotFlag.CLIPPED, 0))
        assert run.digest() == hashlib.sha256(codes.tobytes()).hexdigest()
        assert run.complete
        assert run.done == (shape.shots,) * len(shape.passes)


def test_the_same_shots_give_the_same_bytes(tmp_path: Path, write_whole: Whole) -> None:
    one, other = write_whole(tmp_path / "one"), write_whole(tmp_path / "other")
    names = sorted(path.name for path in (one / "shards").iterdir())
    assert names == [f"{number:06d}.h5" for number in range(6)]
    for name in [*(f"shards/{name}" for name in names), "plan.h5", "journal.jsonl", "data.h5"]:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


def test_the_journal_says_what_each_shard_completes(whole: Path) -> None:
    lines = journal(whole)
    assert [line["pass"] for line in lines] == [0, 0, 0, 1, 1, 1]
    assert [line["first"] for line in lines] == [0, 3, 6, 0, 3, 6]
    assert [line["count"] for line in lines] == [3, 3, 1, 3, 3, 1]
    assert [line["shots"] for line in lines] == [0, 0, 0, 3, 3, 1]
    assert {line["passes"] for line in lines} == {2}
    for line in lines:
        shard = whole / "shards" / f"{line['shard']:06d}.h5"
        assert hashlib.sha256(shard.read_bytes()).hexdigest() == line["sha256"]


def test_a_directory_that_holds_something_is_not_touched(whole: Path, begin: Begin) -> None:
    before = {path: path.stat().st_mtime_ns for path in whole.rglob("*")}
    with pytest.raises(RunExists, match=r"whole: exists and is not empty; pick another --out, or `labctl resume"):
        begin(whole)
    assert {path: path.stat().st_mtime_ns for path in whole.rglob("*")} == before


@pytest.mark.parametrize("taken", ["journal.jsonl", "shards/000000.h5", "notes.txt", "plan.h5/mine"])
def test_only_what_a_killed_process_leaves_is_used(tmp_path: Path, begin: Begin, taken: str) -> None:
    (tmp_path / "run" / "shards").mkdir(parents=True)
    for name in ("plan.h5", "journal.jsonl", "manifest.json.tmp"):
        if not taken.startswith(f"{name}/"):
            (tmp_path / "run" / name).touch()
    (tmp_path / "run" / taken).parent.mkdir(exist_ok=True)
    (tmp_path / "run" / taken).write_text("something")
    with pytest.raises(RunExists):
        begin(tmp_path / "run")
    (tmp_path / "run" / taken).unlink()
    if taken.count("/") == 1 and not taken.startswith("shards"):
        (tmp_path / "run" / taken).parent.rmdir()
    begin(tmp_path / "run").abandon()


def test_a_link_is_not_taken_for_what_a_killed_process_left(tmp_path: Path, begin: Begin) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "run" / "shards").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(RunExists):
        begin(tmp_path / "run")


def test_two_processes_do_not_begin_one_run(tmp_path: Path, begin: Begin) -> None:
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "journal.jsonl").touch()
    with held(tmp_path / "run" / "journal.jsonl"), pytest.raises(RunInUse, match="another process is writing this run"):
        begin(tmp_path / "run")
    begin(tmp_path / "run").abandon()


def test_an_empty_directory_will_do_and_a_file_will_not(tmp_path: Path, begin: Begin) -> None:
    (tmp_path / "empty").mkdir()
    begin(tmp_path / "empty").abandon()
    (tmp_path / "file").touch()
    with pytest.raises(RunExists, match="file: is a file"):
        begin(tmp_path / "file")


def test_a_run_larger_than_the_disk_is_refused_before_it_begins(tmp_path: Path, begin: Begin, small: RunShape) -> None:
    with pytest.raises(RunError, match=r"up to .* GB are needed and the disk has .* free: make room"):
        begin(tmp_path / "run", replace(small, samples=10**15))
    assert not (tmp_path / "run").exists()


def test_the_manifest_gets_what_reading_needs_and_keeps_the_rest(whole: Path) -> None:
    values = json.loads((whole / "manifest.json").read_text())
    assert next(iter(values)) == "format_version"
    assert values["seed"] == 7
    assert values["shape"]["passes"] == [[2, 3, 4, 5], [6]]
    assert values["durability"]["shots"] == 3


def test_a_plan_of_another_length_is_refused(
    tmp_path: Path, small: RunShape, plan_for: Callable[[RunShape], NDArray[Any]]
) -> None:
    with pytest.raises(ValueError, match="the plan has 8 shots, the shape 7"):
        RunWriter.create(tmp_path / "run", {}, small, plan_for(replace(small, shots=8)))
    assert not (tmp_path / "run").exists()


def test_old_shots_reach_the_disk_though_no_new_one_comes(
    tmp_path: Path, begin: Begin, measure: Measure, small: RunShape
) -> None:
    timers = HandTimers()
    with begin(tmp_path / "run", timer=timers) as writer:
        writer.scales(0, 1e-3, 0)
        writer.append(0, 0, measure(small, 0, 0), 1)
        writer.append(0, 1, measure(small, 0, 1), 1)
        assert writer.done == (0, 0)
        assert [timer.seconds for timer in timers if timer.running] == [3600]  # one, begun by the oldest shot
        timers[0].fire()
        assert [line.get("suspect") for line in journal(tmp_path / "run")] == [NOT_COMPARED]
        writer.append(0, 2, measure(small, 0, 2), 1)
        assert len(timers) == 2
        assert writer.done == (2, 0)
        assert [(line["shard"], line["shots"]) for line in journal(tmp_path / "run")] == [(0, 0), (0, 0)]


class HandClock:
    """A clock that is set by hand, s."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_shot_that_would_be_alone_in_its_shard_does_not_wait_for_others(
    tmp_path: Path, begin: Begin, measure: Measure, small: RunShape
) -> None:
    timers, clock = HandTimers(), HandClock()
    with begin(tmp_path / "run", timer=timers, clock=clock) as writer:
        writer.scales(0, 1e-3, 0)
        waits = []
        for shot, gap_s in enumerate((0, 3600, 7200, 3599, 1, 5000)):
            clock.now += gap_s
            writer.append(0, shot, measure(small, 0, shot), 1)
            waits.append(timers[-1].seconds)
            if shot != 3:  # no more shards than if each had waited
                timers[-1].fire()
        assert waits == [3600, 0, 0, 3600, 3600, 0]
        assert dict.fromkeys(line["first"] for line in journal(tmp_path / "run")) == dict.fromkeys([0, 1, 2, 3, 5])


def fails_from_now_on(folder: Path) -> None:
    folder.rmdir()
    folder.write_bytes(b"")


def test_a_disk_that_fails_while_nobody_waits_is_reported_by_the_next_call(
    tmp_path: Path, begin: Begin, measure: Measure, small: RunShape
) -> None:
    timers = HandTimers()
    writer = begin(tmp_path / "run", timer=timers)
    writer.scales(0, 1e-3, 0)
    writer.append(0, 0, measure(small, 0, 0), 1)
    fails_from_now_on(tmp_path / "run" / "shards")
    timers[0].fire()
    for call in (lambda: writer.append(0, 1, measure(small, 0, 1), 1), writer.sync, writer.finish):
        with pytest.raises(RunError, match=r"000000\.h5: cannot be written: .*labctl resume"):
            call()
    timers[0].fire()  # too late to matter


def test_a_failure_that_was_not_seen_yet_ends_the_block(
    tmp_path: Path, begin: Begin, measure: Measure, small: RunShape
) -> None:
    timers = HandTimers()

    def broken_disk(error: Exception | None) -> None:
        with begin(tmp_path / f"run{error}", timer=timers) as writer:
            writer.scales(0, 1e-3, 0)
            writer.append(0, 0, measure(small, 0, 0), 1)
            fails_from_now_on(writer.paths.shards)
            timers[-1].fire()
            if error:
                raise error

    with pytest.raises(RunError, match="cannot be written"):
        broken_disk(None)
    with pytest.raises(ZeroDivisionError) as noted:
        broken_disk(ZeroDivisionError())
    assert any("cannot be written" in note for note in noted.value.__notes__)


def test_the_wall_timer_does_not_keep_the_process_alive() -> None:
    timer = wall_timer(3600, lambda: None)
    assert getattr(timer, "daemon", False)


def test_shards_close_at_their_size(tmp_path: Path, begin: Begin, measure: Measure, small: RunShape) -> None:
    writer = begin(tmp_path / "run")
    writer.abandon()
    sized = RunWriter.resume(tmp_path / "run", Durability(100, 3600, shard_bytes=2 * 4 * small.samples))
    with sized as writer:
        writer.scales(0, 1e-3, 0)
        for shot in range(5):
            writer.append(0, shot, measure(small, 0, shot), 1)
        assert writer.done == (4, 0)
    assert [line["count"] for line in journal(tmp_path / "run")] == [2, 2, 1]


def test_sync_and_a_change_of_pass_close_the_shard(
    tmp_path: Path, begin: Begin, measure: Measure, small: RunShape
) -> None:
    with begin(tmp_path / "run") as writer:
        writer.scales(0, 1e-3, 0)
        writer.scales(1, 1e-3, 0)
        writer.append(0, 0, measure(small, 0, 0), 1)
        writer.append(1, 0, measure(small, 1, 0), 2)
        assert writer.done == (1, 0)
        writer.sync()
        assert (writer.done, writer.complete) == ((1, 1), 1)
        writer.append(0, 4, measure(small, 0, 4), 1)
        writer.append(0, 2, measure(small, 0, 2), 1)
        assert writer.done == (2, 1)
    with open_run(tmp_path / "run") as run:
        assert run.shots["index"].tolist() == [0]
        assert run.done == (3, 1)


def test_mistakes_of_the_caller(tmp_path: Path, begin: Begin, measure: Measure, small: RunShape) -> None:
    with begin(tmp_path / "run") as writer:
        good = measure(small, 0, 0)
        with pytest.raises(ValueError, match="scales of pass 0 are not set"):
            writer.append(0, 0, good)
        writer.scales(0, 1e-3, 0)
        writer.scales(1, 1e-3, 0)
        writer.append(0, 0, good)
        writer.append(1, 0, measure(small, 1, 0), 2)
        for shot, wrong, message in (
            (0, good, r"shots 0\.\.0 of pass 0 are in the run already"),
            (7, good, r"shots 7\.\.7 are not among 0\.\.6"),
            (1, replace(good, codes=good.codes.astype(np.int16)), "frames of int16"),
            (1, replace(good, codes=good.codes[:, :2]), r"frames of int8 \(1, 2, 16\) are not those"),
            (1, replace(good, clipped=good.clipped[:, :2]), "must have shape"),
        ):
            with pytest.raises(ValueError, match=message):
                writer.append(0, shot, wrong)


def test_the_vertical_range_is_locked_for_the_whole_run(cut: Path) -> None:
    with RunWriter.resume(cut) as writer:
        locked = writer.locked_scales(1)
        assert locked is not None
        np.testing.assert_array_equal(locked[0], [2e-3])
        with pytest.raises(RunError, match=r"pass 1 is locked at \[0\.002\] V per code"):
            writer.scales(1, 3e-3, 0.05)
        writer.scales(1, [2e-3], 0.05)


def test_an_interrupted_run_keeps_what_is_complete(
    tmp_path: Path, begin: Begin, measure_missing: Finish, measure_until: Callable[[RunWriter, int], None]
) -> None:
    def interrupted() -> None:
        with begin(tmp_path / "run") as writer:
            measure_until(writer, 5)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    with open_run(tmp_path / "run" / "data.h5") as data:
        assert (len(data.frames), data.suspect, data.complete) == (3, 2, False)
    with open_run(tmp_path / "run") as run:
        assert (len(run.frames), run.suspect, run.complete, run.done) == (3, 2, False, (7, 3))
    with RunWriter.resume(tmp_path / "run") as writer:
        measure_missing(writer)
    with open_run(tmp_path / "run") as run:
        assert run.complete


def test_a_run_without_a_complete_shot_has_no_data_file(
    tmp_path: Path, begin: Begin, measure: Measure, small: RunShape
) -> None:
    with begin(tmp_path / "run") as writer:
        writer.scales(0, 1e-3, 0)
        writer.append(0, 0, measure(small, 0, 0), 1)
    assert not (tmp_path / "run" / "data.h5").exists()
    with open_run(tmp_path / "run") as run:
        assert run.frames[:].shape == run.frames.shape == (0, 5, 16)
        assert run.shots.size == 0
        assert np.isnan(run.scale[4])


def test_a_finished_writer_takes_nothing_more(tmp_path: Path, begin: Begin, measure_missing: Finish) -> None:
    writer = begin(tmp_path / "run")
    measure_missing(writer)
    assert writer.finish(compression="gzip")
    assert writer.finish()
    with pytest.raises(RunError, match="this run is closed"):
        writer.sync()


def test_two_writers_of_one_run(tmp_path: Path, begin: Begin) -> None:
    with begin(tmp_path / "run"), pytest.raises(RunError, match="another process is writing this run"):
        RunWriter.resume(tmp_path / "run")
    RunWriter.resume(tmp_path / "run").abandon()


def test_what_is_in_doubt_is_marked_left_out_and_measured_again(
    tmp_path: Path, begin: Begin, measure: Measure, measure_missing: Finish, small: RunShape
) -> None:
    directory = tmp_path / "run"
    with begin(directory, shots=2) as writer:
        measure_missing(writer)
        assert writer.complete == small.shots
        writer.doubt("scope: CH1:SCAle was 1 and is 2", 1, small.shots - 2)
        assert writer.complete == small.shots - 3, "whole shards are put in doubt"
    report = verify_run(directory)
    assert (report.intact, report.complete, report.suspect, report.data_file) == (True, False, 3, "current")
    assert "3 records are suspect: scope: CH1:SCAle was 1 and is 2" in report.notes
    assert json.loads((directory / "manifest.json").read_text())["suspect"] == {"scope: CH1:SCAle was 1 and is 2": 3}
    for path in (directory, directory / "data.h5"):
        with open_run(path) as run:
            assert (len(run.frames), run.suspect) == (small.shots - 3, 3)
            assert run.shots["index"].tolist() == list(range(small.shots - 3))
            assert run.frames[-1].tobytes() == run.frames[:][-1].tobytes()
    with h5py.File(directory / "data.h5") as file:
        assert file["shots"]["suspect"].tolist() == [0] * (small.shots - 3) + [1] * 3
    with RunWriter.resume(directory) as writer:
        assert writer.missing(1).tolist() == list(range(small.shots - 3, small.shots))
        measure_missing(writer)
    report = verify_run(directory)
    assert (report.intact, report.complete, report.suspect, report.data_file) == (True, True, 0, "current")
    assert "suspect" not in json.loads((directory / "manifest.json").read_text())
    assert len(list((directory / "shards").glob("*.suspect"))) == 2, "what was measured is not thrown away"


def test_shots_that_nobody_is_sure_of_are_suspect_until_somebody_is(
    tmp_path: Path, begin: Begin, measure: Measure, small: RunShape
) -> None:
    sure = False
    with begin(tmp_path / "run", shots=2) as writer:
        writer.scales(0, 1e-3, 0)
        for shot in range(4):
            writer.append(0, shot, measure(small, 0, shot), 1, sure=lambda: sure)
        assert writer.done == (0, 0)
        sure = True
        writer.append(0, 4, measure(small, 0, 4), 1, sure=lambda: sure)
        assert writer.done == (4, 0)
    assert [line["shard"] for line in journal(tmp_path / "run")] == [0, 1, 0, 1, 2]
