"""A protocol in a file of one's own: what it must define, and how it is told what is wrong with it."""

import os
from pathlib import Path

import pytest

from protocols.base import Judgement, ProtocolError
from protocols.registry import protocol_class, read_protocol
from tests.checkout import ROOT

EXAMPLE = ROOT / "docs" / "how-to" / "examples" / "bench_extras.py"
IMPORTS = "from typing import ClassVar\nfrom protocols.image_readout import ImageReadout\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "mine.py"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_protocol_of_a_file_takes_settings_and_remembers_its_file() -> None:
    found = read_protocol(str(EXAMPLE), ["repeats=20", "window=1 ns"])
    assert (found.name, found.model_dump()["repeats"], found.model_dump()["window"]) == ("repeatability", 20, 1e-9)
    assert found.source_file is not None
    assert (found.source_file.path, found.source_file.content) == (EXAMPLE, EXAMPLE.read_bytes())
    with pytest.raises(ProtocolError, match="--set: colour: repeatability has no such setting: choose from seed"):
        read_protocol(str(EXAMPLE), ["colour=red"])


def test_another_text_is_another_protocol(tmp_path: Path) -> None:
    one = read_protocol(str(EXAMPLE), []).digest()
    assert read_protocol(str(EXAMPLE), []).digest() == one
    same = written(tmp_path, EXAMPLE.read_text("utf-8"))
    assert read_protocol(str(same), []).digest() == one, "wherever it lies"
    other = written(tmp_path, EXAMPLE.read_text("utf-8") + "\n# slower\n")
    assert read_protocol(str(other), []).digest() != one


def test_it_may_be_made_of_an_installed_one(tmp_path: Path) -> None:
    text = f'{IMPORTS}class Mine(ImageReadout):\n    """Mine."""\n    name: ClassVar[str] = "mine"\n    gap: int = 3\n'
    found = read_protocol(str(written(tmp_path, text)), ["gap=4", "images=40"])
    assert (found.name, found.judgement, found.model_dump()["gap"]) == ("mine", Judgement.READOUT, 4)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 +", r"mine\.py, line 1: SyntaxError: invalid syntax: correct it"),
        ("\n\nwindow = 1 / 0", r"mine\.py, line 3: ZeroDivisionError: division by zero: correct it"),
        ("import sys\nsys.exit(3)", r"mine\.py, line 2: SystemExit: 3: correct it"),
        ("import not_there", r"mine\.py, line 1: ModuleNotFoundError: No module named 'not_there': correct it"),
        (IMPORTS, r"mine\.py: defines 0 protocols \(none\): write one"),
        (
            f"{IMPORTS}class A(ImageReadout): pass\nclass B(ImageReadout): pass",
            r"mine\.py: defines 2 protocols \(A, B\): write one",
        ),
        (
            "from protocols.base import Images, Measurement\nclass A(Measurement[Images]): pass",
            r"mine\.py: A lacks acquire, check, drive, duration_s, passes, sample_count, shots: write them",
        ),
        (f"{IMPORTS}class A(ImageReadout): pass", "'image-readout' is that of an installed protocol: choose another"),
        (f'{IMPORTS}class A(ImageReadout):\n    name = "../up"', "A has no name that a folder can have: write name:"),
        ("#" * 70_000, "is larger than 65536 bytes"),
        ("s = '\0'", r"mine\.py"),
    ],
)
def test_what_is_wrong_is_told_in_one_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ProtocolError, match=message) as error:
        read_protocol(str(written(tmp_path, text)), [])
    assert "\n" not in str(error.value)


def test_what_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "waits.py")
    for name in ("nowhere.py", "waits.py"):
        with pytest.raises(ProtocolError, match=f"{name}: cannot be read"):
            read_protocol(str(tmp_path / name), [])


def test_no_text_but_that_of_the_operator_leads_to_a_file(tmp_path: Path) -> None:
    evil = written(tmp_path, f"open({str(tmp_path / 'done')!r}, 'w')")
    with pytest.raises(ProtocolError, match="is not installed"):
        protocol_class(str(evil))
    settings = tmp_path / "stranger.toml"
    settings.write_text(f'protocol = "{evil}"\n', encoding="utf-8")
    with pytest.raises(ProtocolError, match="is not installed"):
        read_protocol(str(settings), [])
    assert not (tmp_path / "done").exists()
