"""The points of a sweep: what each sets, and what is refused before anything is made."""

import json
import re
from pathlib import Path
from typing import Any

import pytest

from labctl.bench.station import SIMULATED_STATION, read_station
from labctl.errors import LabctlError, StationError, UsageError
from labctl.runs.sweep import FILE, Sweep, places, read
from labctl.runs.sweep_axes import Order
from labctl.studies.sweeps.declaration import points, read_sweep
from labctl.studies.sweeps.folder import begin, station_of
from protocols.image_readout import ImageReadout
from tests.checkout import ROOT

PAGE = ROOT / "docs" / "how-to" / "sweep.md"
OVER = 'protocol = "a"\n[over]\na = '


def sweep(**over: tuple[str, ...]) -> Sweep:
    return Sweep(protocol="image-readout", over=over, order=Order.AS_GIVEN, reference_every=0)


def test_settings_keys_and_short_names() -> None:
    asked = Sweep(
        protocol="image-readout",
        settings={"images": 40},
        over={"window": ("0.4 ns",), "power": ("10 mW",), "awg.amplitude": ("0.2 Vpp",), "sim.parameters.enob": ("5",)},
        reference_every=0,
    )
    [point] = points(asked, ImageReadout, SIMULATED_STATION)
    assert (point.protocol.window, point.protocol.images) == (0.4e-9, 40)  # type: ignore[attr-defined]
    assert (point.station.laser.power, point.station.awg.amplitude) == (0.01, 0.2)
    assert point.station.sim.parameters == {"enob": 5.0}
    assert point.coordinates == {
        "window": 0.4e-9,
        "power": 0.01,
        "awg.amplitude": 0.2,
        "sim.parameters.enob": 5.0,
    }
    assert point.name == "000-window=0.4ns-power=10mW-awg.amplitude=0.2Vpp-sim.parameters.enob=5"


@pytest.mark.parametrize("sign", ["\u00b5", "\u03bc", "u"])
def test_the_micro_sign_is_in_the_name_of_a_run(sign: str, tmp_path: Path) -> None:
    [point] = points(sweep(power=(f"9000 {sign}W",)), ImageReadout, SIMULATED_STATION)
    assert (point.name, point.station.laser.power) == ("000-power=9000uW", 0.009)
    begin(tmp_path, sweep(power=(f"9000 {sign}W",)), ImageReadout, SIMULATED_STATION)
    assert [name for name, _ in places(read(tmp_path).sweep)] == [point.name]


def test_runs_of_a_sweep_that_was_begun_when_names_dropped_it_are_found(tmp_path: Path) -> None:
    begin(tmp_path, sweep(power=("9000 \u00b5W",)), ImageReadout, SIMULATED_STATION)
    file = tmp_path / FILE
    said = json.loads(file.read_text("utf-8"))
    file.write_text(json.dumps(said | {"format_version": "1.2"}), "utf-8")
    assert [name for name, _ in places(read(tmp_path).sweep)] == ["000-power=9000W"]


def test_a_station_that_is_named_otherwise_has_not_changed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bench.toml").write_text('[laser]\ncommands = "tlg.toml"\n', encoding="utf-8")
    begin(Path("sweep"), sweep(window=("0.4 ns",)), ImageReadout, read_station(Path("bench.toml")))
    named = read_station(tmp_path / "bench.toml")
    assert station_of(Path("sweep"), read(Path("sweep")), ImageReadout, named) == named
    changed = named.model_copy(update={"name": "another"})
    with pytest.raises(StationError, match="has changed since the sweep was begun"):
        station_of(Path("sweep"), read(Path("sweep")), ImageReadout, changed)


def test_a_list_of_one_is_a_number_and_what_is_no_number_is_its_text() -> None:
    wavelengths = points(sweep(wavelength=("1550 nm", "1551 nm")), ImageReadout, SIMULATED_STATION)
    assert [point.coordinates["wavelength"] for point in wavelengths] == [1550.0, 1551.0]
    timing = points(sweep(timing=("software", "burst")), ImageReadout, SIMULATED_STATION)
    assert [point.coordinates["timing"] for point in timing] == ["software", "burst"]


@pytest.mark.parametrize(
    ("over", "told"),
    [
        ({"pwer": ("1 mW",)}, "pwer: is no setting of image-readout and no key of the station: choose from power"),
        ({"laser.pwer": ("1 mW",)}, "laser.pwer: built-in station has no such key"),
        (
            {"laser.wavelength": ("1550 nm",)},
            "laser.wavelength: image-readout tunes the laser itself: vary a setting of it, such as wavelengths",
        ),
        ({"power": ("1",)}, "laser.power"),
        ({"window": ("1 mW",)}, "window"),
        ({"power": ("10 mW",), "laser.power": ("5 mW",)}, "laser.power: another axis sets laser.power too"),
        ({"laser.power": ("10 mW",), "power": ("5 mW",)}, "power: another axis sets laser.power too"),
        ({"wavelengths": ("1550 nm",), "wavelength": ("1551 nm",)}, "wavelength: another axis sets wavelengths too"),
    ],
)
def test_what_cannot_be_varied(over: dict[str, tuple[str, ...]], told: str) -> None:
    with pytest.raises(LabctlError) as raised:
        points(sweep(**over), ImageReadout, SIMULATED_STATION)
    assert told in str(raised.value)


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "sweep.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_file(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        'protocol = "image-readout"\norder = "interleaved"\nsettings = { images = 40 }\n\n'
        '[over]\nports = ["2-4", "2,5"]\npower = "10:30:3 mW"\n',
    )
    found = read_sweep(path)
    assert found.over == {"ports": ("2-4", "2,5"), "power": ("10 mW", "20 mW", "30 mW")}
    assert (found.order, found.reference_every) == (Order.INTERLEAVED, 10)


def test_a_file_may_leave_its_axes_to_the_options(tmp_path: Path) -> None:
    path = written(tmp_path, 'protocol = "image-readout"\nsettings = { images = 40 }\n')
    found = read_sweep(path, over={"power": ("10 mW",)}, settings={"ports": "2"}, others={"zip": True})
    assert (found.over, found.settings, found.zip) == ({"power": ("10 mW",)}, {"images": 40, "ports": "2"}, True)


def test_an_option_stands_instead_of_what_the_file_says_of_the_same_name(tmp_path: Path) -> None:
    path = written(tmp_path, 'protocol = "a"\n[settings]\na = 1\nb = 1\n[over]\nd = "1,,2"\nc = "1,2"\n')
    found = read_sweep(path, over={"d": ("3",)}, settings={"b": "2"})
    assert (found.over, found.settings) == ({"d": ("3",), "c": ("1", "2")}, {"a": 1, "b": "2"})


@pytest.mark.parametrize("text", ["settings = 3", "over = 3"])
def test_what_should_be_a_table_is_refused_whatever_the_options(text: str, tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=rf"sweep\.toml: {text.split()[0]}"):
        read_sweep(written(tmp_path, f'protocol = "a"\n{text}\n'), over={"d": ("3",)}, settings={"b": "2"})


def test_values_in_a_file_may_be_numbers(tmp_path: Path) -> None:
    path = written(tmp_path, 'protocol = "image-readout"\n\n[over]\nseed = [1, 2]\n"sim.parameters.enob" = [4.5, 5]\n')
    assert read_sweep(path).over == {"seed": ("1", "2"), "sim.parameters.enob": ("4.5", "5")}


def test_the_file_in_the_documents_is_one(tmp_path: Path) -> None:
    (block,) = re.findall(r"^```toml\n(.*?)^```", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert len(points(read_sweep(written(tmp_path, block)), ImageReadout, SIMULATED_STATION)) == 11


@pytest.mark.parametrize("text", ["", "protocol = 3", 'protocol = "image-readout"', "[", f"{OVER}1", f"{OVER}[]"])
def test_files_that_say_no_sweep(tmp_path: Path, text: Any) -> None:
    with pytest.raises(UsageError, match=r"sweep\.toml: ") as raised:
        read_sweep(written(tmp_path, text))
    assert "\n" not in str(raised.value)
