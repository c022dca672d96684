import hashlib
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from labctl.errors import RunError
from labctl.runs.catalogue import Catalogue
from labctl.runs.format.journal import NOT_COMPARED, read_journal
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter

Finish = Callable[..., None]


def resume_to_the_end(directory: Path, measure_missing: Finish) -> tuple[str, ...]:
    with RunWriter.resume(directory) as writer:
        measure_missing(writer)
    report = verify_run(directory)
    assert (report.complete, report.shots, report.data_file) == (True, 7, "current")
    return writer.recovered


def digest(directory: Path) -> str:
    with open_run(directory) as run:
        return run.digest()


def test_a_resumed_run_ends_like_an_uninterrupted_one(cut: Path, whole: Path, measure_missing: Finish) -> None:
    with RunWriter.resume(cut) as writer:
        assert writer.recovered == ()
        assert [writer.missing(p).tolist() for p in (0, 1)] == [[], [3, 4, 5, 6]]
        measure_missing(writer)
    assert digest(cut) == digest(whole)
    for name in ("journal.jsonl", "data.h5", "shards/000004.h5"):
        assert (cut / name).read_bytes() == (whole / name).read_bytes()


def test_a_shard_that_missed_the_journal_is_measured_again(cut: Path, whole: Path, measure_missing: Finish) -> None:
    lines = (cut / "journal.jsonl").read_bytes().splitlines(keepends=True)
    (cut / "journal.jsonl").write_bytes(b"".join(lines[:-1]) + lines[-1][:40])
    assert open_run(cut).done == (7, 0)
    assert any("torn" in note for note in verify_run(cut).notes)
    assert (
        "000003.h5: not in the journal, and of no use: `labctl resume` measures again what is missing of its shots"
    ) in verify_run(cut).notes
    found = resume_to_the_end(cut, measure_missing)
    assert "was not in the journal yet" in found[0]
    assert f"3 shots are suspect ({NOT_COMPARED}): they are to be measured again" in found
    assert [path.name for path in (cut / "shards").glob("*.suspect")] == ["000003.h5.suspect"]
    assert not verify_run(cut).problems
    assert digest(cut) == digest(whole)


@pytest.mark.parametrize("shard", [0, 3])
@pytest.mark.parametrize("harm", ["flip", "remove"])
def test_a_damaged_shard_is_measured_again(
    cut: Path, whole: Path, measure_missing: Finish, shard: int, harm: str
) -> None:
    path = cut / "shards" / f"{shard:06d}.h5"
    if harm == "flip":
        image = bytearray(path.read_bytes())
        image[len(image) // 2] ^= 4
        path.write_bytes(image)
    else:
        path.unlink()
    assert len(verify_run(cut).problems) == 1
    with pytest.raises(RunError, match=rf"{shard:06d}\.h5: (damaged|cannot be read)"):
        open_run(cut).frames[:]
    found = resume_to_the_end(cut, measure_missing)
    assert "its 3 shots are to be measured again" in found[0]
    assert (cut / "shards" / f"{shard:06d}.h5.damaged").exists() == (harm == "flip")
    assert not verify_run(cut).problems
    assert digest(cut) == digest(whole)
    lines = [json.loads(line) for line in (cut / "journal.jsonl").read_text().splitlines()]
    assert sum(line["shots"] for line in lines) == 7
    assert Catalogue(cut.parent).find()[0].row.shots == 7


@pytest.mark.parametrize("harm", ["flip", "cut", "remove"])
def test_a_damaged_shard_is_made_again_from_the_data_file(whole: Path, harm: str) -> None:
    before = {path: path.read_bytes() for path in whole.rglob("*") if path.is_file()}
    for number in (0, 5):
        path = whole / "shards" / f"{number:06d}.h5"
        if harm == "flip":
            image = bytearray(before[path])
            image[len(image) // 2] ^= 4
            path.write_bytes(image)
        elif harm == "cut":
            path.write_bytes(before[path][:-1])
        else:
            path.unlink()
    told: list[str] = []
    with RunWriter.resume(whole, on_warning=told.append) as writer:
        assert [writer.missing(p).tolist() for p in (0, 1)] == [[], []]
    assert {path: path.read_bytes() for path in whole.rglob("*") if path.is_file()} == before
    assert told == [
        f"{whole}/shards/{number:06d}.h5: was missing or damaged, and is made again from data.h5" for number in (0, 5)
    ]


def test_so_is_one_of_an_earlier_version(whole: Path) -> None:
    shards = sorted((whole / "shards").iterdir())
    entries = read_journal(whole / "journal.jsonl").entries
    for path in (*shards, whole / "data.h5"):
        with h5py.File(path, "r+") as file:
            file.attrs.get_id("format_version").write(np.array(b"1.2", h5py.string_dtype("utf-8", 3)))
    earlier = [path.read_bytes() for path in shards]
    lines = [
        replace(entry, sha256=hashlib.sha256(image).hexdigest()).encode()
        for entry, image in zip(entries, earlier, strict=True)
    ]
    (whole / "journal.jsonl").write_bytes(b"".join(lines))
    for path in shards:
        path.unlink()
    with RunWriter.resume(whole) as writer:
        assert writer.complete == 7
    assert [path.read_bytes() for path in shards] == earlier


def test_only_what_the_data_file_has_not_is_measured_again(whole: Path, measure_missing: Finish) -> None:
    frames = digest(whole)
    for number in (1, 5):
        (whole / "shards" / f"{number:06d}.h5").write_bytes(b"")
    with h5py.File(whole / "data.h5", "r+") as file:
        file["epoch"][6, 1] += 1  # of the last shot of the second pass, which is all of its last shard
    with RunWriter.resume(whole) as writer:
        assert [writer.missing(p).tolist() for p in (0, 1)] == [[], [6]]
        measure_missing(writer)
    assert verify_run(whole).data_file == "current"
    assert digest(whole) == frames


@pytest.mark.parametrize("unreadable", ["shards/000001.h5", "data.h5"])
def test_what_cannot_be_read_is_not_taken_for_damaged(whole: Path, unreadable: str) -> None:
    (whole / "shards" / "000000.h5").write_bytes(b"")
    (whole / unreadable).unlink()
    (whole / unreadable).mkdir()
    before = {path: path.is_dir() or path.read_bytes() for path in whole.rglob("*")}
    assert any("is a folder where a run has a file" in problem for problem in verify_run(whole).problems)
    with pytest.raises(RunError, match=rf"{unreadable}: cannot be read \(is a folder where a run has a file"):
        RunWriter.resume(whole)
    assert {path: path.is_dir() or path.read_bytes() for path in whole.rglob("*")} == before


def test_half_written_files_go(cut: Path, measure_missing: Finish) -> None:
    (cut / "shards" / "000004.h5.tmp").write_bytes(b"half")
    (cut / "data.h5.tmp").write_bytes(b"half")
    assert "000004.h5.tmp: half-written, of no use" in verify_run(cut).notes
    assert len(resume_to_the_end(cut, measure_missing)) == 2
    assert not list(cut.rglob("*.tmp"))


def test_strange_files_among_the_shards_are_left_alone(cut: Path, measure_missing: Finish) -> None:
    shards = cut / "shards"
    (shards / "notes.h5").write_bytes(b"mine")
    (shards / "000090.h5").write_bytes(b"no shard")
    (shards / "000091.h5").write_bytes((shards / "000001.h5").read_bytes())
    (shards / "²³.h5").write_bytes(b"digits, and no number")
    (shards / "mine.tmp").mkdir()
    (cut / "mine.tmp").mkdir()
    found = resume_to_the_end(cut, measure_missing)
    assert "000090.h5: damaged shard" in found[0]
    assert "ignored" in found[0]
    assert "000091.h5: the journal does not name it and has its shots, ignored" in found[1]
    assert len(found) == 2
    assert (shards / "000090.h5").read_bytes() == b"no shard"
    assert (shards / "mine.tmp").is_dir()
    assert (cut / "mine.tmp").is_dir()
    assert (shards / "000092.h5").exists()


def test_resuming_a_whole_run_makes_its_data_file_again(whole: Path, measure_missing: Finish) -> None:
    before = (whole / "data.h5").read_bytes()
    (whole / "data.h5").unlink()
    assert resume_to_the_end(whole, measure_missing) == ()
    assert (whole / "data.h5").read_bytes() == before


def test_what_is_no_run_cannot_be_resumed(tmp_path: Path, cut: Path) -> None:
    with pytest.raises(RunError, match="not a run directory"):
        RunWriter.resume(tmp_path)
    (cut / "plan.h5").write_bytes(b"")
    with pytest.raises(RunError, match=r"plan\.h5: damaged"):
        RunWriter.resume(cut)
    (cut / "plan.h5").unlink()
    with pytest.raises(RunError, match=r"plan\.h5: cannot be read"):
        RunWriter.resume(cut)
