"""Every example in the documents is run or read by something; here, what neither the build nor another test takes."""

import re
import tomllib
from pathlib import Path
from textwrap import dedent
from typing import Any

import numpy as np
import pytest

from instruments.command_table import UNKNOWN
from instruments.laser_table import DEFAULT_TABLE, LaserTable
from instruments.sections import InstrumentSection
from labctl.bench.drivers import installed
from labctl.bench.station import Station, read_station
from labctl.commands.main import main
from tests.checkout import PAGES, README, ROOT
from tests.labctl.reports.figures.drawn import check_figure, legend, noise

BLOCK = re.compile(r"^ *```(\S*)[^\n]*\n(.*?)^ *```", re.MULTILINE | re.DOTALL)


def blocks(page: Path, language: str) -> list[str]:
    return [dedent(block) for name, block in BLOCK.findall(page.read_text("utf-8")) if name == language]


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name == "tutorial"], ids=lambda page: page.stem)
def test_no_answer_of_a_tutorial_is_written_by_hand(page: Path) -> None:
    """The directive `typed` shows what commands answer; other blocks hold what is typed alone."""
    typed = [line for block in blocks(page, "") for line in block.splitlines()]
    assert not [line for line in typed if not line.startswith(("labctl ", "python ", "source ", "pip "))]


STATIONS = [
    pytest.param(block, id=f"{page.stem}-{place}")
    for page in PAGES
    for place, block in enumerate(blocks(page, "toml"))
    if tomllib.loads(block).keys() <= set(Station.model_fields)
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_python_is_written_where_the_build_runs_it(page: Path) -> None:
    """In `testcode` or `doctest`, not in a block that is only coloured."""
    assert not [name for name, _ in BLOCK.findall(page.read_text("utf-8")) if name in {"python", "py", "pycon"}]


@pytest.mark.parametrize("block", STATIONS)
def test_a_station_file_is_read(block: str, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(block, encoding="utf-8")
    read_station(path)


def test_what_a_new_role_touches_is_there() -> None:
    text = (ROOT / "docs" / "how-to" / "add-an-instrument-role.md").read_text("utf-8")
    named = re.findall(r"`((?:docs|instruments|labctl|sim_backends|tests)/[\w/.-]+)`", text)
    assert named
    assert not [path for path in named if not (ROOT / path).exists()]


def test_the_reference_names_every_driver_and_its_keys() -> None:
    text = (ROOT / "docs" / "reference" / "station.md").read_text("utf-8")
    for name, found in installed().items():
        assert f"`{name}`" in text
        own = found.section.model_fields.keys() - InstrumentSection.model_fields.keys()
        assert not [key for key in own if f"`{key}`" not in text and f"`{found.role}.{key}`" not in text]


def test_the_lasers_commands_are_taken() -> None:
    (block,) = blocks(ROOT / "docs" / "how-to" / "correct-the-lasers-commands.md", "toml")
    table = tomllib.loads(DEFAULT_TABLE.read_text("utf-8"))
    entries = tomllib.loads(block)["commands"]
    assert entries.keys() <= table["commands"].keys()
    read = LaserTable.model_validate(table | {"commands": table["commands"] | entries})
    assert all(read.commands[name].write != UNKNOWN for name in entries)


def test_the_readme_reads_a_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (block,) = blocks(README, "python")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["run", "image-readout", "--set", "images=4", "--set", "window=0.4 ns", "--out", "runs/a"])
    assert ended.value.code == 0
    capsys.readouterr()
    exec(compile(block, "README.md", "exec"), {})  # noqa: S102
    assert capsys.readouterr().out.startswith("[2 3 4 5 6]")


def test_the_figure_that_is_added_is_sound(tmp_path: Path) -> None:
    module, _ = blocks(ROOT / "docs" / "how-to" / "add-a-figure.md", "{testcode}")
    names: dict[str, Any] = {}
    exec(compile(module, "spectrum.py", "exec"), names)  # noqa: S102

    def draw() -> Any:
        return names["spectrum_figure"](np.arange(50) * 40e-12, noise(2, 50), ports=["port 2", "port 3"])

    check_figure(draw, tmp_path)
    assert legend(draw()) == ["port 2", "port 3"]
