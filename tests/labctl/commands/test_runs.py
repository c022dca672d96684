"""Runs are found again, by what they are and by what people say of them."""

import json
import os
import shutil
import sqlite3
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

import labctl
from labctl.errors import UsageError
from labctl.runs.catalogue import FILE, VERSION, Catalogue
from tests.labctl.commands.conftest import AsJson, Typed


@pytest.fixture
def folder(bench_run: Path, tmp_path: Path) -> Path:
    """Three copies of a run."""
    for name in ("first", "second", "third"):
        shutil.copytree(bench_run, tmp_path / "runs" / name)
    return tmp_path / "runs"


def names(as_json: AsJson, folder: Path, *words: str) -> list[str]:
    status, found = as_json("runs", folder, *words)
    assert status == 0
    return [Path(one["run"]).name for one in found["runs"]]


def test_a_note_finds_a_run_again(folder: Path, typed: Typed, as_json: AsJson) -> None:
    status, out, err = typed("note", folder / "second", "fibre touched", "--tag", "good", "--star", "--operator", "Ada")
    assert (status, err) == (0, "")
    assert "second: starred, by Ada, good\n" in out
    assert out.endswith(": fibre touched\n")
    assert names(as_json, folder, "--where", "tag = good and images >= 24") == ["second"]
    assert names(as_json, folder, "--where", "operator = ada and note ~ touched") == ["second"]
    assert names(as_json, folder, "--where", "touched") == ["second"]
    assert names(as_json, folder, "--where", "not star = 1") == ["first", "third"]
    assert names(as_json, folder, "--where", "star") == ["second"]
    assert names(as_json, folder, "--where", "alarm") == []
    typed("note", folder / "second", "--untag", "good")
    assert names(as_json, folder, "--where", "protocol = image-readout and star = 1") == ["second"]
    status, _, err = typed("runs", folder, "--where", "tag = good")
    assert (status, err.count("\n")) == (2, 1)
    assert "tag: no run here has that" in err


def test_how_well_a_readout_scored(folder: Path, typed: Typed, as_json: AsJson) -> None:
    status, trained = as_json("train", folder / "third", "--window", "0.4 ns")
    assert status == 0
    assert names(as_json, folder, "--where", f"accuracy >= {trained['accuracy']}") == ["third"]
    assert names(as_json, folder, "--sort", "accuracy") == ["first", "second", "third"]
    _, out, _ = typed("runs", folder, "--columns", "accuracy,window", "--limit", "1", "--sort", "accuracy")
    assert f"{trained['accuracy']:.6g}" in out
    assert "4e-10" in out
    _, out, _ = typed("runs", folder, "--keys")
    assert {"accuracy", "images", "protocol", "started", "window"} <= set(out.strip().split(", "))


@pytest.mark.parametrize("limit", [0, -1])
def test_fewer_runs_than_one_are_refused(tmp_path: Path, typed: Typed, limit: int) -> None:
    told = f"limit = {limit}: ask for one run or more"
    status, out, err = typed("runs", tmp_path, "--limit", limit)
    assert (status, out, err) == (2, "", f"labctl: {told}\n")
    with pytest.raises(UsageError, match=f"^{told}$"):
        labctl.runs(folder=tmp_path, limit=limit)


def test_a_column_that_no_run_has_is_refused(folder: Path, tmp_path: Path, typed: Typed) -> None:
    status, out, err = typed("runs", folder, "--columns", "images,acuracy")
    assert (status, out) == (2, "")
    assert err == "labctl: acuracy: no run here has that: see `labctl runs --keys`\n"
    assert typed("runs", folder, "--columns", "imges")[2].endswith("did you mean images?\n")
    assert typed("runs", folder, "--sort", "imges")[2].endswith("did you mean images?\n")
    (tmp_path / "empty").mkdir()
    status, out, _ = typed("runs", tmp_path / "empty", "--columns", "images")
    assert (status, out) == (0, f"{tmp_path / 'empty'}: no runs yet\n")


def test_the_catalogue_is_made_again_at_any_time(folder: Path, as_json: AsJson) -> None:
    everything = ["first", "second", "third"]
    assert names(as_json, folder) == everything
    (folder / FILE).write_bytes(b"no database")
    assert names(as_json, folder) == everything
    (folder / FILE).unlink()
    names(as_json, folder)
    with closing(sqlite3.connect(folder / FILE)) as other:
        other.execute(f"PRAGMA user_version = {VERSION + 1}")
    assert names(as_json, folder) == everything
    (folder / FILE).unlink()
    with closing(sqlite3.connect(folder / FILE)) as other:
        other.execute("CREATE TABLE run (other)")
    assert names(as_json, folder) == everything
    with closing(sqlite3.connect(folder / FILE)) as other:
        assert other.execute("SELECT name FROM sqlite_master").fetchall() == [("run",)], (
            "of somebody else, and as it was"
        )
    (folder / FILE).unlink()
    shutil.rmtree(folder / "second")
    assert names(as_json, folder) == ["first", "third"]


def damaged_inside(catalogue: Path) -> None:
    """Everything behind the page that says what file it is."""
    whole = catalogue.read_bytes()
    catalogue.write_bytes(whole[:4096] + b"x" * (len(whole) - 4096))


def rows_as(text: str) -> Callable[[Path], None]:
    """Rows that labctl has not written."""

    def written(catalogue: Path) -> None:
        with closing(sqlite3.connect(catalogue)) as other, other:
            other.execute("UPDATE run SET row = ?", [text])

    return written


def without_its_tables(catalogue: Path) -> None:
    with closing(sqlite3.connect(catalogue)) as other, other:
        other.execute("DROP TABLE run")


@pytest.mark.parametrize(
    "damage", [damaged_inside, rows_as('{"name": '), rows_as("{}"), rows_as("[]"), rows_as("null"), without_its_tables]
)
@pytest.mark.parametrize("rests", [0.0, 10.0])
def test_a_catalogue_that_is_damaged_is_made_anew(folder: Path, damage: Callable[[Path], None], rests: float) -> None:
    assert len(Catalogue(folder).find()) == 3
    before, asked = Catalogue(folder, rests=rests), Catalogue(folder, rests=rests)
    assert len(before.find()) == 3
    damage(folder / FILE)
    for catalogue in (asked, before):
        assert [one.row.name for one in catalogue.find(sort="name")] == ["first", "second", "third"]
        assert catalogue.has("second")
    assert len(Catalogue(folder).find()) == 3
    with closing(sqlite3.connect(folder / FILE)) as other:
        assert other.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        assert other.execute("SELECT row ->> 'protocol' FROM run").fetchall() == [("image-readout",)] * 3


def test_a_catalogue_that_is_gone_is_made_anew_at_once_however_long_it_rests(folder: Path) -> None:
    catalogue = Catalogue(folder, rests=1e9)
    assert len(catalogue.find()) == 3
    (folder / FILE).unlink()
    assert len(catalogue.find()) == 3


@contextmanager
def no_room() -> Iterator[None]:
    """No file of this process may grow, nor be written behind its first page."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of files")
@pytest.mark.parametrize("rests", [0.0, 10.0])
def test_runs_are_found_where_the_catalogue_can_no_longer_be_written(folder: Path, rests: float) -> None:
    catalogue = Catalogue(folder, rests=rests)
    assert len(catalogue.find()) == 3
    shutil.copytree(folder / "first", folder / "fourth")
    with no_room():
        catalogue.look_again()
        assert len(catalogue.find()) == 4
        assert len(catalogue.find()) == 4, "and not what the file says that could not be written"
        assert catalogue.has("fourth")
    assert len(Catalogue(folder).find()) == 4


def test_a_link_in_its_place_leads_nowhere(folder: Path, tmp_path: Path, as_json: AsJson) -> None:
    (folder / FILE).symlink_to(tmp_path / "elsewhere.sqlite")
    assert names(as_json, folder) == ["first", "second", "third"]
    assert not (tmp_path / "elsewhere.sqlite").exists()


def test_what_is_not_unicode_is_listed_as_well(folder: Path, as_json: AsJson) -> None:
    strange = folder / os.fsdecode(b"fou\xffth")
    (folder / "first").rename(strange)
    values = json.loads((strange / "manifest.json").read_text("utf-8"))
    values["protocol"]["settings"] |= {"dataset": "\ud800", "images": 10**400, "\ud801": 1}
    (strange / "manifest.json").write_text(json.dumps(values), "utf-8")
    assert len(names(as_json, folder)) == 3
    assert len(names(as_json, folder, "--where", "not images > 1")) == 1


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="nothing is forbidden to this user")
def test_a_folder_that_cannot_be_written_is_listed_as_well(folder: Path, as_json: AsJson) -> None:
    folder.chmod(0o500)
    assert names(as_json, folder) == ["first", "second", "third"]
    folder.chmod(0o700)


def test_another_process_may_write_the_catalogue_at_the_same_time(folder: Path) -> None:
    Catalogue(folder).find()
    other = sqlite3.connect(folder / FILE)
    other.execute("BEGIN EXCLUSIVE")
    assert len(Catalogue(folder).find()) == 3
    other.close()


def test_what_is_said_at_the_start_is_there_as_if_it_was_said_later(
    as_json: AsJson, typed: Typed, tmp_path: Path
) -> None:
    small = ("run", "image-readout", "--set", "images=8", "--set", "window=0.4 ns", "--set", "ports=2")
    words = ("--note", "new fibre", "--tag", "good", "--tag", "fig 3", "--star", "--operator", "Ada")
    assert as_json(*small, *words, "--out", str(tmp_path / "run"))[0] == 0
    _, found = as_json("note", str(tmp_path / "run"))
    assert (found["tags"], found["star"], found["operator"]) == (["fig 3", "good"], True, "Ada")
    assert [one["text"] for one in found["notes"]] == ["new fibre"]
    status, _, told = typed(*small, "--tag", "x" * 200, "--out", str(tmp_path / "other"))
    assert (status, "write 1 to 100 characters" in told) == (2, True)
    assert not (tmp_path / "other").exists(), "before anything is opened"
