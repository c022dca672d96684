"""The schemas that editors use: they pass what labctl takes, refuse what is mistyped, and lie in the documents."""

import json
import re
import tomllib
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from labctl.bench.schema import STATION, names, schema_of
from labctl.bench.station import read_station, write_addresses
from labctl.commands.main import main
from tests.checkout import PAGES, README, ROOT

STORED = ROOT / "docs" / "reference" / "schemas"
BLOCK = re.compile(r"^```toml\n(.*?)^```", re.MULTILINE | re.DOTALL)
KEYS = {"protocol", "name", *schema_of(STATION)["properties"]}
BLOCKS = [
    pytest.param(block, id=f"{path.stem}-{place}")
    for path in (*PAGES, README)
    for place, block in enumerate(BLOCK.findall(path.read_text("utf-8")))
    if tomllib.loads(block).keys() & KEYS and "over" not in tomllib.loads(block)  # a sweep
]


def problems(name: str, content: dict[str, Any]) -> list[str]:
    schema = schema_of(name)
    return [error.message for error in jsonschema.Draft202012Validator(schema).iter_errors(content)]


@pytest.mark.parametrize("name", names())
def test_each_is_a_schema_and_the_stored_one_is_current(name: str) -> None:
    """Otherwise: labctl schema --write docs/reference/schemas."""
    jsonschema.Draft202012Validator.check_schema(schema_of(name))
    assert json.loads((STORED / f"{name}.schema.json").read_text("utf-8")) == schema_of(name)


def test_no_schema_of_something_else_is_stored() -> None:
    assert {path.name for path in STORED.glob("*.json")} == {f"{name}.schema.json" for name in names()}


@pytest.mark.parametrize("block", BLOCKS)
def test_the_files_in_the_documents_are_valid(block: str, tmp_path: Path) -> None:
    content = tomllib.loads(block)
    assert not problems(content.get("protocol", STATION), content)


def test_the_file_that_serve_saves_is_valid(tmp_path: Path) -> None:
    path = tmp_path / "served.toml"
    write_addresses(path, {"awg": "TCPIP0::127.0.0.1::9::SOCKET"})
    assert not problems(STATION, tomllib.loads(path.read_text("utf-8")))


STATIONS_THAT_ARE_TAKEN = (
    "[awg]\namplitude = '500 mVpp'",
    "[laser]\npower = '14.8 dBm'\nwavelength = '1.55 µm'",
    "[scope]\ntrigger_source = 2\ntimeout = '1 min'",
    "[scope]\ntrigger_source = 'aux'",
    "[patch_panel]\nports = '0,2-6'",
    "[patch_panel]\nports = [0, 2, 3]",
    "[patch_panel]\nports = 3",
    "[sim]\nparameters = { enob = 4.5 }",
    "[laser]\ndriver = 'alnair-tlg-220'\ncommands = 'table.toml'",
    "[laser]\ndriver = 'manual-laser'\npower = '10 mW'",
    "[dmd]\ndriver = 'ti-dlpc900'\naddress = 'usb'",
    "[power_meter]\ndriver = 'thorlabs-pm100'\ntap = 0.01",
    "[amplifier]\ndriver = 'table-amplifier'\npower = '23 dBm'",
    "[dmd]\ndriver = 'ti-dlpc900'\naddress = 'TCPIP0::192.0.2.1::5000::SOCKET'",
)
STATIONS_THAT_ARE_NOT = (
    "colour = 'red'",
    "[awg]\ncolour = 'red'",
    "[awg]\namplitude = 0.4",
    "[awg]\nchannel = 3",
    "[awg]\namplitude = '0.5'",
    "[awg]\namplitude = '0.5 W'",
    "[power_meter]\ndriver = 'thorlabs-pm100'",
    "[power_meter]\ntap = 0.01",
    "[thermometer]\ndriver = 'thorlabs-pm100'",
    "[laser]\npower = '30 V'",
    "[scope]\ntrigger_source = 5",
    "[scope]\ntrigger_slope = 'up'",
    "[scope]\ntimeout = 'soon'",
    "[patch_panel]\nports = '2-x'",
    "[patch_panel]\nports = [15]",
    "[limits]\noptical_power = true",
    "[durability]\nshots = 0",
    "source = 'elsewhere'",
    "[laser]\ndriver = 'nothing'",
    "[laser]\ndriver = 'vialux-alp'",
    "[laser]\ndriver = 'manual-laser'\ncolour = 'red'",
)


@pytest.mark.parametrize("text", STATIONS_THAT_ARE_TAKEN)
def test_a_station_that_is_taken_passes(text: str, tmp_path: Path) -> None:
    path = tmp_path / "bench.toml"
    path.write_text(text, encoding="utf-8")
    read_station(path)
    assert not problems(STATION, tomllib.loads(text))


@pytest.mark.parametrize("text", STATIONS_THAT_ARE_NOT)
def test_a_station_that_is_mistyped_does_not(text: str) -> None:
    assert problems(STATION, tomllib.loads(text))


@pytest.mark.parametrize(
    ("name", "settings", "valid"),
    [
        ("image-readout", {"images": "2000,500", "ports": "2-6", "window": "0.4 ns", "wavelengths": "1550 nm"}, True),
        ("image-readout", {"images": 40, "classes": [0, 1], "wavelengths": ["1550 nm", 1551.0], "window": 4e-10}, True),
        ("dynamic-scene", {"switch": [1, 2], "switch_after": "4.6 us"}, True),
        ("sequence-readout", {"symbols": 100}, True),
        ("wavelength-scan", {"step": "2 pm"}, True),
        ("image-readout", {"images": 0}, False),
        ("image-readout", {"window": "0.4 V"}, False),
        ("image-readout", {"timing": "fast"}, False),
        ("image-readout", {"colour": "red"}, False),
        ("dynamic-scene", {"switch": [1]}, False),
        ("wavelength-scan", {"steps": 1}, False),
    ],
)
def test_settings_of_protocols(name: str, settings: dict[str, Any], *, valid: bool) -> None:
    assert (not problems(name, {"protocol": name, "settings": settings})) == valid


class TestCommand:
    def test_prints_one_and_nothing_else(self, capsys: pytest.CaptureFixture[str]) -> None:
        with pytest.raises(SystemExit) as ended:
            main(["schema", "station", "--json"])
        printed = capsys.readouterr().out
        assert (ended.value.code, printed.count("\n")) == (0, 1)
        assert json.loads(printed) == schema_of(STATION)

    def test_writes_all(self, tmp_path: Path) -> None:
        with pytest.raises(SystemExit) as ended:
            main(["schema", "--write", str(tmp_path / "schemas")])
        assert ended.value.code == 0
        for path in STORED.glob("*.json"):
            assert (tmp_path / "schemas" / path.name).read_text("utf-8") == path.read_text("utf-8")

    @pytest.mark.parametrize("words", [["schema"], ["schema", "nothing"], ["schema", "station", "--write", "x"]])
    def test_wrong_use_names_what_there_is(self, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 2
        assert "image-readout" in capsys.readouterr().err
