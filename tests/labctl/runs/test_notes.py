"""What people say of a run: appended, folded, and checked by itself."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.errors import RunError
from labctl.runs.format.checked_line import TornLine, decode, encode
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import LARGEST, LONGEST_NOTE, Notes, read_notes, say_of
from labctl.runs.verification import verify_run


@given(st.dictionaries(st.text(), st.none() | st.booleans() | st.integers() | st.text() | st.lists(st.text())))
def test_a_line_says_what_it_was_made_of_and_any_change_is_found(values: dict[str, object]) -> None:
    values = {"time": "now"} | {key: value for key, value in values.items() if key != "crc"}
    line = encode(values)
    assert line.endswith(b"}\n")
    assert line.count(b"\n") == 1
    assert decode(line) == values
    with pytest.raises(TornLine):
        decode(line[:-3])
    changed = bytearray(line)
    changed[len(line) // 2] ^= 1
    with pytest.raises(ValueError, match=r"whole line|checksum"):
        decode(bytes(changed))


def test_what_was_said_last_counts_and_nothing_is_lost(whole: Path) -> None:
    paths = RunPaths(whole)
    assert read_notes(paths) == Notes()
    say_of(paths, "fibre touched at noon", tags=["good", "to  be shown"], operator="ada")
    say_of(paths, "again", untagged=["good"], tags=["good fibre"], star=True)
    say_of(paths, star=False)
    found = read_notes(paths)
    assert [note.text for note in found.notes] == ["fibre touched at noon", "again"]
    assert found.notes[0].time.endswith("+00:00")
    assert (found.tags, found.star, found.operator, found.problems) == (("good fibre", "to be shown"), False, "ada", ())
    assert len(paths.notes.read_bytes().splitlines()) == 3


def test_what_was_measured_is_as_it_was(whole: Path) -> None:
    before = {path: path.read_bytes() for path in whole.rglob("*") if path.is_file()}
    say_of(RunPaths(whole), "good")
    assert all(path.read_bytes() == data for path, data in before.items())
    assert verify_run(whole).intact


def test_damage_is_told_and_touches_nothing_else(whole: Path) -> None:
    paths = RunPaths(whole)
    for word in ("one", "two", "three"):
        say_of(paths, word)
    data = paths.notes.read_bytes().replace(b"two", b"ten")
    paths.notes.write_bytes(data[:-5])
    say_of(paths, "four")
    found = read_notes(paths)
    assert [note.text for note in found.notes] == ["one", "four"]
    assert found.problems == (
        "notes.jsonl line 2: checksum is wrong",
        "notes.jsonl line 3: not a whole line",
    )
    report = verify_run(whole)
    assert report.intact
    assert [note for note in report.notes if "notes.jsonl" in note] == list(found.problems)


@pytest.mark.parametrize(("text", "tags"), [("", []), ("x" * (LONGEST_NOTE + 1), []), ("", [" "]), ("", ["x" * 101])])
def test_what_cannot_be_said_is_refused(whole: Path, text: str, tags: list[str]) -> None:
    with pytest.raises(RunError):
        say_of(RunPaths(whole), text, tags=tags)
    assert not RunPaths(whole).notes.exists()


def test_what_is_no_run_has_no_notes(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="not a run directory"):
        say_of(RunPaths(tmp_path), "x")


def test_a_picture_lies_beside_the_notes_and_no_other_file_is_named(whole: Path) -> None:
    paths = RunPaths(whole)
    say_of(paths, "fibre touched", picture=b"a PNG")
    say_of(paths, picture=b"another")
    first, second = read_notes(paths).notes
    assert (first.text, second.text) == ("fibre touched", "")
    assert [(paths.pictures / one.picture).read_bytes() for one in (first, second)] == [b"a PNG", b"another"]
    assert verify_run(whole).intact
    paths.notes.write_bytes(encode({"time": "now", "by": "eve", "note": "look", "picture": "../../secret.png"}))
    assert read_notes(paths).notes[0].picture == ""


def test_what_a_stranger_has_said_is_text_that_may_be_shown(whole: Path) -> None:
    paths = RunPaths(whole)
    paths.notes.write_bytes(encode({"time": "now", "by": "eve", "tags": ["go\u202eod"], "operator": "\x1b[2Jada"}))
    found = read_notes(paths)
    assert (found.tags, found.operator) == (("go\\u202eod",), "\\x1b[2Jada")
    say_of(paths, untagged=found.tags)
    assert read_notes(paths).tags == ()


def test_notes_that_cannot_be_read_are_a_finding_and_no_damage_of_what_was_measured(whole: Path) -> None:
    with RunPaths(whole).notes.open("wb") as file:
        file.truncate(LARGEST + 1)
    report = verify_run(whole)
    assert report.intact
    (said,) = [note for note in report.notes if "notes.jsonl" in note]
    assert "cannot be read" in said
    assert "\n" not in said
