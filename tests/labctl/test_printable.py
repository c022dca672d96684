"""What is printed, printed for programs, and logged holds nothing that a terminal would obey."""

import json
import logging
import sys
from pathlib import Path

import pytest

from labctl.commands.main import main
from labctl.printable import PrintableFormatter, json_line, printable, typed, typed_path

OBEYED = "\x1b[2J\x07\x9b31m\x7f\u202e\u2066\u200f\ud800\r\n\t"


def test_what_can_be_shown_stays_as_it_is() -> None:
    assert printable("Fabry-Pérot ± 3 µm, 光子, 👍 'a\\b'") == "Fabry-Pérot ± 3 µm, 光子, 👍 'a\\b'"


def test_the_rest_is_written_out() -> None:
    shown = r"\x1b[2J\x07\x9b31m\x7f\u202e\u2066\u200f\ud800\r\n\t"
    assert printable(OBEYED) == shown
    assert json.loads(json_line({OBEYED: OBEYED})) == {OBEYED: OBEYED}
    assert json_line(OBEYED)[:-1].isprintable()


def test_what_is_to_be_typed_has_the_quotes_of_the_system(monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("resume", r"runs\a b", r"C:\runs\c")
    monkeypatch.setattr(sys, "platform", "linux")
    assert typed(*words) == r"resume 'runs\a b' 'C:\runs\c'"
    monkeypatch.setattr(sys, "platform", "win32")
    assert typed(*words) == r'resume "runs\a b" C:\runs\c'


def test_a_path_that_is_to_be_typed_is_no_option() -> None:
    assert [typed_path(Path(path)) for path in ("-dash", "a/-b", "/-b")] == ["./-dash", "a/-b", "/-b"]


def test_a_log_line_is_one_line_of_text() -> None:
    try:
        raise ValueError(OBEYED)
    except ValueError as error:
        record = logging.LogRecord("a", logging.WARNING, "", 0, "%s said %s", ("scope", OBEYED), None)
        failed = logging.LogRecord("a", logging.ERROR, "", 0, "x", (), (ValueError, error, error.__traceback__))
    assert PrintableFormatter().format(record) == rf"scope said {printable(OBEYED)}"
    assert all(line.isprintable() for line in PrintableFormatter().format(failed).split("\n"))


def test_what_is_typed_wrong_is_told_in_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["runs", "--sort", "\x1b[2J\nlabctl: all is well"])
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert said[:-1].isprintable()
