"""The power fails after every single step towards the disk, and what was not synced is gone, torn or there."""

import copy
from collections.abc import Callable
from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.format.shape import RunShape
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter
from tests.labctl.runs.write.disk import Disk, Tree, lay_out, recorded

Told = tuple[int, ...]
Tell = Callable[[RunWriter], None]
Steps = list[tuple[Disk, Told]]
"""The disk after each step, and how many shots of each pass the program had been told are on it by then."""

FIRST_STEPS = 8
"""Of a resumed run that differ from those of any run: what it finds is put in order."""
NOTHING: Told = (0, 0)
HELD = pytest.mark.parametrize(
    ("shots", "every"), [(3, 4), *(pytest.param(shots, 1, marks=pytest.mark.full) for shots in (3, 1))]
)
"""Shots of a shard, and which of the states are looked at."""


def steps_of(write: Callable[[Path, Tell], None], directory: Path, disk: Disk) -> Steps:
    told = [NOTHING]
    steps: Steps = []
    with recorded(directory.parent, disk, lambda: steps.append((copy.deepcopy(disk), told[-1]))):
        write(directory, lambda writer: told.append(writer.done))
    return [*steps, (disk, told[-1])]


def states(steps: Steps) -> list[tuple[Tree, Told]]:
    """What may be found when the power fails after any of the steps; once what differs in half-written files alone."""
    found: dict[frozenset[tuple[str, bytes | None]], tuple[Tree, Told]] = {}
    for disk, told in steps:
        for tree in disk.extremes():
            named = frozenset((path, None if path.endswith(".tmp") else content) for path, content in tree.items())
            found[named] = tree, told
    return list(found.values())


def renamed(disk: Disk) -> bool:
    """Whether a file has its final name, and not for good yet."""
    return any(not path.endswith(".tmp") for change in disk.changes for path, node in change.items() if node)


@pytest.fixture
def writing(
    begin: Callable[..., RunWriter], measure: Callable[..., object], small: RunShape, shots: int
) -> Callable[..., None]:
    def write(directory: Path, tell: Tell) -> None:
        with begin(directory, small, shots) as writer:
            measure_all(writer, tell)
        tell(writer)

    def measure_all(writer: RunWriter, tell: Tell) -> None:
        for index in range(len(small.passes)):
            writer.scales(index, 1e-3 * (index + 1), 0.05)
            for shot in writer.missing(index):
                writer.append(index, int(shot), measure(small, index, int(shot)), index + 1)  # type: ignore[arg-type]
                tell(writer)

    return write


@pytest.fixture
def going_on(measure_missing: Callable[[RunWriter], None]) -> Callable[[Path, Tell], None]:
    def resume(directory: Path, tell: Tell) -> None:
        with RunWriter.resume(directory) as writer:
            tell(writer)
            measure_missing(writer)
        tell(writer)

    return resume


@pytest.fixture
def check(
    small: RunShape, write_whole: Callable[..., Path], going_on: Callable[[Path, Tell], None], tmp_path: Path
) -> Callable[[Tree, Told], None]:
    with open_run(write_whole(tmp_path / "whole", small)) as run:
        whole = run.digest()
    places = iter(range(1_000_000))

    def holds(tree: Tree, told: Told) -> None:
        root = tmp_path / f"after-{next(places)}"
        root.mkdir()
        lay_out(tree, root)
        directory = root / "run"
        if not (directory / "manifest.json").exists():
            assert told == NOTHING
            with pytest.raises(RunError, match="not a run directory"):
                verify_run(directory)
            return
        found = verify_run(directory)
        assert found.problems == ()
        assert all(there >= said for there, said in zip(found.passes, told, strict=True))
        going_on(directory, lambda _writer: None)
        report = verify_run(directory)
        assert (report.complete, report.data_file, report.problems) == (True, "current", ())
        assert all("set aside as suspect" in note for note in report.notes)  # what the journal did not name yet
        with open_run(directory) as run:
            assert run.digest() == whole

    return holds


@HELD
def test_what_was_told_to_be_on_disk_outlives_the_power(
    tmp_path: Path, writing: Callable[[Path, Tell], None], check: Callable[[Tree, Told], None], every: int
) -> None:
    (tmp_path / "disk").mkdir()
    found = states(steps_of(writing, tmp_path / "disk" / "run", Disk()))
    assert len(found) > 30
    for tree, told in found[::every]:
        check(tree, told)


@HELD
def test_so_does_what_a_resumed_run_took_over_from_one_that_was_killed(
    tmp_path: Path,
    writing: Callable[[Path, Tell], None],
    going_on: Callable[[Path, Tell], None],
    check: Callable[[Tree, Told], None],
    every: int,
) -> None:
    """A killed process leaves names that are there and not yet sure."""
    (tmp_path / "disk").mkdir()
    steps = steps_of(writing, tmp_path / "disk" / "run", Disk())
    killed = [disk for disk, _ in steps if "run/manifest.json" in disk.seen and renamed(disk)]
    assert len(killed) > 6
    resumed: Steps = []
    for number, disk in enumerate(killed):
        root = tmp_path / f"killed-{number}"
        root.mkdir()
        lay_out(disk.after(range(len(disk.changes)), lambda node: node.seen), root)
        resumed += steps_of(going_on, root / "run", disk)[:FIRST_STEPS]
    for tree, told in states(resumed)[::every]:
        check(tree, told)


def test_a_run_in_new_folders_outlives_the_power(
    tmp_path: Path, begin: Callable[..., RunWriter], measure: Callable[..., object], small: RunShape
) -> None:
    disk, directory = Disk(), tmp_path / "one" / "two" / "run"
    with recorded(tmp_path, disk, lambda: None):
        writer = begin(directory, small, 1)
        writer.scales(0, 1e-3, 0.05)
        writer.append(0, 0, measure(small, 0, 0), 1)  # type: ignore[arg-type]
        writer.abandon()
    left = disk.after(range(0), lambda node: node.sure)
    assert {"one/two/run/manifest.json", "one/two/run/journal.jsonl", "one/two/run/shards/000000.h5"} <= left.keys()
