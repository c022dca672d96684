"""What is said of runs at their start, as a sweep keeps it."""

import json
from pathlib import Path

import pytest

from labctl.errors import RunError
from labctl.runs.said import Said
from labctl.runs.sweep import FILE, Sweep, SweepFile, read


def kept(tmp_path: Path, text: str) -> Path:
    (tmp_path / FILE).write_text(text, encoding="utf-8")
    return tmp_path


def file(said: Said) -> SweepFile:
    return SweepFile(sweep=Sweep(protocol="a", over={"b": ("1",)}), station="c", station_sha256="", said=said)


@pytest.mark.parametrize("text", ["half a letter \udcff", "\x1b[31mred", "  blanks  ", "two\nlines"])
def test_it_is_kept_in_the_file_of_a_sweep_whatever_was_typed(tmp_path: Path, text: str) -> None:
    said = Said(note=text, tags=(text,), star=True, operator=text)
    assert said.note.isprintable()
    assert read(kept(tmp_path, file(said).model_dump_json())).said == said


def test_a_sweep_of_before_says_nothing(tmp_path: Path) -> None:
    values = json.loads(file(Said()).model_dump_json())
    del values["said"]
    assert read(kept(tmp_path, json.dumps(values | {"format_version": "1.0"}))).said == Said()


def test_what_no_command_writes_is_refused(tmp_path: Path) -> None:
    values = json.loads(file(Said()).model_dump_json())
    with pytest.raises(RunError, match="a note of 5000 characters: write 4000 at most"):
        read(kept(tmp_path, json.dumps(values | {"said": {"note": "x" * 5000}})))
