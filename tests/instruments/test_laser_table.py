"""The operator's command table of the laser."""

from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from instruments.alnair_tlg220 import Tlg220
from instruments.errors import LightLost, NotConfigured
from instruments.laser_table import DEFAULT_TABLE, LaserTable
from instruments.table_attenuator import SIMULATED_TABLE, AttenuatorTable
from instruments.table_link import TableLink
from labctl.bench.simulation import SIMULATED_LASER
from tests.instruments.test_visa import Script


def write(folder: Path, text: str) -> Path:
    path = folder / "laser.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_shipped_table_is_refused_until_somebody_fills_it_in() -> None:
    with pytest.raises(NotConfigured, match=r"alnair_tlg220\.toml: commands\.\w+\.write = '<unknown>'.*manual-laser"):
        LaserTable.read(DEFAULT_TABLE).require_complete()


def test_a_complete_table_still_has_to_be_verified(tmp_path: Path) -> None:
    text = SIMULATED_LASER.read_text("utf-8").replace("verified = true", "verified = false")
    table = LaserTable.read(write(tmp_path, text))
    table.require_complete()
    with pytest.raises(NotConfigured, match="verified = false"):
        table.require_verified()


def test_the_simulated_lasers_table_is_ready() -> None:
    table = LaserTable.read(SIMULATED_LASER)
    table.require_complete()
    table.require_verified()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("verified = true", "model: Field required"),
        ("model = [", "cannot be read"),
        ('model = "x"\nverified = true\ncolour = "red"\n[commands]', "colour"),
    ],
)
def test_a_damaged_table_is_named(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(NotConfigured, match=message):
        LaserTable.read(write(tmp_path, text))


def test_a_missing_table_is_named(tmp_path: Path) -> None:
    with pytest.raises(NotConfigured, match=r"nowhere\.toml"):
        LaserTable.read(tmp_path / "nowhere.toml")


def test_a_switch_may_answer_in_words(tmp_path: Path, log: Any) -> None:
    def in_words(table: Path) -> Path:
        return write(tmp_path, table.read_text("utf-8").replace("[01]", "\\\\w+"))

    with closing(Script(b"ON\n", b"off\n", b"1\n")) as script:
        table = AttenuatorTable.read(in_words(SIMULATED_TABLE))
        with closing(TableLink(script.address, table, name="attenuator", transcript=log)) as link:
            assert [link.number("get_open") for _ in range(3)] == [1, 0, 1]
    with (
        closing(Script(b"ON\n", b"OFF\n", b'0,""\n')) as script,
        closing(Tlg220(script.address, LaserTable.read(in_words(SIMULATED_LASER)), log)) as laser,
    ):
        laser.require_emission()
        with pytest.raises(LightLost):
            laser.require_emission()
