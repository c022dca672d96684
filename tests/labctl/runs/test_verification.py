from collections.abc import Callable
from functools import partial
from pathlib import Path

import h5py
import pytest

from instruments.values import Frames
from labctl.errors import RunError, RunInUse
from labctl.runs.format.journal import Entry, JournalFile, held
from labctl.runs.format.shape import RunShape
from labctl.runs.verification import Damage, RunReport, verify_run
from labctl.runs.write.writer import RunWriter


def flip(path: Path, position: int) -> None:
    image = bytearray(path.read_bytes())
    image[position] ^= 1
    path.write_bytes(image)


def of_byte(report: RunReport) -> tuple[str, int]:
    """File and place of the first damage, which must be one byte."""
    assert report.damaged is not None
    assert report.damaged.first == report.damaged.last
    return report.damaged.file, report.damaged.first


def test_a_whole_run(whole: Path) -> None:
    report = verify_run(whole)
    assert (report.complete, report.shots, report.planned, report.passes) == (True, 7, 7, (7, 7))
    assert (report.shards, report.data_file, report.problems, report.notes) == (6, "current", (), ())


def test_an_incomplete_run_is_no_problem(cut: Path) -> None:
    report = verify_run(cut)
    assert (report.complete, report.shots, report.passes, report.problems) == (False, 3, (7, 3), ())
    assert report.data_file == "missing"
    assert verify_run(cut, rebuild=True).data_file == "current"
    assert verify_run(cut).notes == ()


def test_every_flipped_byte_of_a_shard_is_found(whole: Path) -> None:
    shard = whole / "shards" / "000002.h5"
    image = shard.read_bytes()
    for position in range(0, len(image), 101):
        flip(shard, position)
        report = verify_run(whole)
        assert report.problems == (
            f"{shard}: damaged: its sha256 is not the journal's: `labctl resume` makes it again from data.h5, or "
            "measures its shots again",
        )
        assert (report.complete, report.shots, report.shards) == (False, 6, 5)
        assert of_byte(report) == ("shards/000002.h5", position)
        shard.write_bytes(image)


def test_where_a_shard_is_damaged_is_told_as_closely_as_the_data_file_allows(whole: Path) -> None:
    shard, data = whole / "shards" / "000002.h5", whole / "data.h5"
    image = shard.read_bytes()
    shard.write_bytes(image[:-10])
    assert verify_run(whole).damaged == Damage("shards/000002.h5", len(image) - 10, len(image) - 1)
    data.unlink()
    assert verify_run(whole).damaged == Damage("shards/000002.h5", 0, len(image) - 11)
    shard.unlink()
    assert verify_run(whole).damaged == Damage("shards/000002.h5", 0, None)


def test_a_missing_shard_is_found_and_the_data_file_kept(whole: Path) -> None:
    (whole / "shards" / "000005.h5").unlink()
    before = (whole / "data.h5").read_bytes()
    report = verify_run(whole, rebuild=True)
    assert len(report.problems) == 1
    assert "000005.h5: cannot be read" in report.problems[0]
    assert "data.h5 was not rebuilt: a shard is damaged" in report.notes
    assert (whole / "data.h5").read_bytes() == before


@pytest.mark.parametrize("name", ["frames", "trigger_offset_s", "clipped", "epoch", "measured_at_s"])
def test_a_changed_value_in_the_data_file_is_found(whole: Path, name: str) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        values = file[name][5]
        values.flat[0] = not values.flat[0] if name == "clipped" else values.flat[0] - 3
        file[name][5] = values
    report = verify_run(whole)
    assert report.problems == (f"{whole / 'data.h5'}: /{name} differs from the shards at shot 5",)
    assert (report.data_file, report.complete) == ("damaged", True)
    assert report.damaged is not None
    assert report.damaged.file == "data.h5"
    assert 0 < report.damaged.first <= (report.damaged.last or 0) < (whole / "data.h5").stat().st_size
    assert verify_run(whole, rebuild=True).data_file == "current"


@pytest.mark.parametrize("name", ["time", "scale", "drive/samples", "manifest", "shots"])
def test_a_changed_constant_in_the_data_file_is_found(whole: Path, name: str) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        if name == "manifest":
            file.attrs["manifest"] = file.attrs["manifest"].replace(b"readout", b"writeout")
        elif name == "shots":
            table = file["shots"][:]
            table["label"][4] += 1
            file["shots"][:] = table
        else:
            file[name][0] += 1
    report = verify_run(whole)
    assert len(report.problems) == 1
    assert name.split("/")[0] in report.problems[0]


@pytest.mark.parametrize(
    ("place", "name", "value"),
    [
        ("/", "complete", False),
        ("/", "suspect", 1),
        ("/", "shots_planned", 8),
        ("/", "format_version", "1.0"),
        ("/scale", "units", "mV"),
        ("/shots", "time_s_units", "ms"),
    ],
)
def test_a_changed_attribute_in_the_data_file_is_found(
    whole: Path, place: str, name: str, value: str | float | bool
) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        stored = file[place].attrs.get_id(name)
        file[place].attrs.create(name, value.encode() if isinstance(value, str) else value, dtype=stored.dtype)
    report = verify_run(whole)
    what = f"the attribute {name!r} of {place}"
    assert report.problems == (f"{whole / 'data.h5'}: {what} is not what the run's would be",)
    assert report.data_file == "damaged"
    assert verify_run(whole, rebuild=True).problems == ()


@pytest.mark.parametrize(("name", "value"), [("amplitude_vpp", 9.9), ("sample_rate", 1e9), ("name", b"ramq")])
def test_a_changed_attribute_of_the_drive_is_found(whole: Path, name: str, value: float | bytes) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        file["drive"].attrs.create(name, value, dtype=file["drive"].attrs.get_id(name).dtype)
    assert verify_run(whole).problems == (f"{whole / 'data.h5'}: /drive differs from the planned one",)


def test_an_axis_that_is_another_is_found(whole: Path) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        file["frames"].dims[0].detach_scale(file["shot"])
    problem = f"{whole / 'data.h5'}: axis 0 of /frames is not what the run's would be"
    assert verify_run(whole).problems == (problem,)


def test_every_flipped_byte_of_an_attribute_is_found(whole: Path) -> None:
    data = whole / "data.h5"
    image = data.read_bytes()
    for text in (b"kind\0", b"what the shot is for", b"dataset_index\0", b"volts = scale", b"amplitude_vpp\0"):
        for position in range(place := image.index(text), place + len(text)):
            flip(data, position)
            assert verify_run(whole).data_file == "damaged", (text, position)
            data.write_bytes(image)


def test_another_coordinate_of_the_shots_is_found(whole: Path) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        file["shot"][3] = 7
    report = verify_run(whole)
    assert report.problems == (f"{whole / 'data.h5'}: /shot is not the list of complete shots",)


def test_shots_under_a_wrong_index_are_found(whole: Path) -> None:
    with h5py.File(whole / "data.h5", "r+") as file:
        table = file["shots"][:]
        table["index"][6] = 9
        file["shots"][:] = table
    assert "/shots.index is not the list of complete shots" in verify_run(whole).problems[0]
    with h5py.File(whole / "data.h5", "r+") as file:
        file["shots"][:] = table[::-1]
    assert "/shots.index is not ascending" in verify_run(whole).problems[0]


def test_a_data_file_that_is_not_whole_is_found(whole: Path) -> None:
    (whole / "data.h5").write_bytes(b"")
    assert verify_run(whole).data_file == "damaged"
    assert not verify_run(whole, rebuild=True).problems


def test_a_data_file_made_before_a_resume_is_stale(cut: Path, measure_missing: Callable[[RunWriter], None]) -> None:
    verify_run(cut, rebuild=True)
    writer = RunWriter.resume(cut)
    measure_missing(writer)
    writer.abandon()
    report = verify_run(cut)
    assert (report.complete, report.data_file, report.problems) == (True, "stale", ())
    assert any("data.h5 is stale" in note for note in report.notes)


def test_a_data_file_is_stale_where_its_shots_were_measured_again(
    whole: Path, small: RunShape, measure: Callable[[RunShape, int, int], Frames]
) -> None:
    flip(whole / "shards" / "000001.h5", 700)
    flip(whole / "shards" / "000005.h5", 700)
    earlier = (whole / "data.h5").rename(whole.with_suffix(".h5"))
    writer = RunWriter.resume(whole)
    writer.scales(0, 1e-3, 0.05)
    for shot in writer.missing(0):
        writer.append(0, int(shot), measure(small, 0, int(shot) + 100), 1)
    writer.abandon()
    earlier.rename(whole / "data.h5")
    report = verify_run(whole)
    assert (report.complete, report.data_file, report.problems) == (False, "stale", ())


def test_a_data_file_is_made_anew_by_one_process_at_a_time(
    tmp_path: Path, whole: Path, begin: Callable[..., RunWriter]
) -> None:
    (whole / "data.h5").write_bytes(b"another one writes it")
    with held(whole / "journal.jsonl"):
        for write in (partial(verify_run, rebuild=True), RunWriter.resume):
            with pytest.raises(RunInUse, match="whole: another process is writing this run"):
                write(whole)
        assert verify_run(whole).data_file == "damaged"
    assert (whole / "data.h5").read_bytes() == b"another one writes it"
    assert verify_run(whole, rebuild=True).data_file == "current"
    writer = begin(tmp_path / "run")
    with pytest.raises(RunInUse, match="run: another process is writing this run"):
        verify_run(tmp_path / "run", rebuild=True)
    writer.abandon()


def test_a_run_without_its_journal_is_damaged_and_gets_none(whole: Path) -> None:
    (whole / "journal.jsonl").unlink()
    report = verify_run(whole, rebuild=True)
    assert "journal.jsonl: cannot be read" in report.problems[0]
    assert not (whole / "journal.jsonl").exists()


def test_a_data_file_is_stale_where_less_is_in_doubt_than_when_it_was_made(
    tmp_path: Path, begin: Callable[..., RunWriter], measure_missing: Callable[[RunWriter], None]
) -> None:
    """The process of a resumed run was killed between its manifest and its data.h5."""
    with begin(tmp_path / "run") as writer:
        measure_missing(writer)
        writer.doubt("somebody turned a knob", 1, 3)
    data = tmp_path / "run" / "data.h5"
    earlier = data.read_bytes()
    with RunWriter.resume(tmp_path / "run") as writer:
        measure_missing(writer)
    data.write_bytes(earlier)
    report = verify_run(tmp_path / "run")
    assert (report.complete, report.data_file, report.problems) == (True, "stale", ())
    with h5py.File(data, "r+") as file:
        file.attrs["manifest"] = file.attrs["manifest"].replace(b"readout", b"writeout")
    assert verify_run(tmp_path / "run").data_file == "damaged"
    assert verify_run(tmp_path / "run", rebuild=True).problems == ()


def test_problems_of_the_journal(whole: Path) -> None:
    path = whole / "journal.jsonl"
    good = path.read_bytes()
    flip(path, 20)
    report = verify_run(whole)
    assert report.problems[0].startswith("journal.jsonl line 1:")
    assert report.damaged == Damage("journal.jsonl", 0, good.index(b"\n"))
    assert not report.complete
    path.write_bytes(good)
    first = Entry.decode(good.splitlines()[0])
    with JournalFile(path) as journal:
        journal.append(Entry(6, 0, 2, 0, 0, 3, first.sha256))
    (whole / "shards" / "000006.h5").write_bytes((whole / "shards" / "000000.h5").read_bytes())
    assert verify_run(whole).problems[0] == "journal.jsonl: pass 0 has shot 0 more than once"


@pytest.mark.parametrize(("passes", "first", "count"), [(3, 0, 1), (2, 6, 2), (2, 3, 0)])
def test_a_line_of_another_run_is_found(whole: Path, passes: int, first: int, count: int) -> None:
    with JournalFile(whole / "journal.jsonl") as journal:
        journal.append(Entry(6, 0, passes, first, 0, count, "0" * 64))
    assert "the line of shard 6 is not of this run" in verify_run(whole).problems[0]


def test_a_shard_under_the_wrong_name_is_found(whole: Path) -> None:
    lines = (whole / "journal.jsonl").read_bytes().splitlines()
    second = Entry.decode(lines[1])
    wrong = Entry(6, 0, 2, 0, 0, 3, second.sha256)
    (whole / "shards" / "000006.h5").write_bytes((whole / "shards" / "000001.h5").read_bytes())
    with JournalFile(whole / "journal.jsonl") as journal:
        journal.append(wrong)
    assert any("holds other shots than the journal says" in problem for problem in verify_run(whole).problems)


def test_damage_that_leaves_nothing_to_check(whole: Path, tmp_path: Path) -> None:
    flip(whole / "plan.h5", 900)
    assert "plan.h5: damaged" in verify_run(whole).problems[0]
    assert verify_run(whole).damaged == Damage("plan.h5", 0, (whole / "plan.h5").stat().st_size - 1)
    (whole / "manifest.json").write_text("{")
    assert "manifest.json: damaged" in verify_run(whole).problems[0]
    assert verify_run(whole).damaged == Damage("manifest.json", 0, 0)
    with pytest.raises(RunError, match="not a run directory"):
        verify_run(tmp_path)
