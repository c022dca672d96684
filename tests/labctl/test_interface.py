"""What `import labctl` offers: a bench in one's hands, runs, sweeps, readouts."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import labctl
from instruments.alnair_tlg220 import Tlg220
from instruments.bench import Observer
from instruments.errors import LightLost, LinkError, OutOfRange, SettingChanged
from instruments.limits import OverLimit
from instruments.tektronix_awg70002a import Awg70002a
from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.vialux_alp import VialuxAlp
from labctl.bench.opening import Access
from labctl.bench.station import SIMULATED_STATION, Station, write_addresses
from labctl.engine.hands import Hands, in_hands
from labctl.errors import LabctlError, RunError, StationError
from labctl.runs.format.origin import Origin
from labctl.runs.sweep import read
from sim_backends.scpi.messages import Message
from tests.checkout import ROOT
from tests.knobs.interloper import VisitedBench


class Emission(Observer):
    """Remembers when light went on and off."""

    def __init__(self) -> None:
        self.seen: list[bool] = []

    def emission(self, *, on: bool) -> None:
        self.seen.append(on)


PAGE = ROOT / "docs" / "reference" / "api.md"


def test_what_is_public_is_listed_and_described() -> None:
    assert labctl.__all__ == [
        "bench",
        "evaluate",
        "live_trace",
        "open_run",
        "open_runs",
        "run",
        "runs",
        "sweep",
        "train",
    ]
    page = PAGE.read_text("utf-8")
    for name in labctl.__all__:
        assert f"autofunction:: labctl.{'' if name.startswith('open') else 'interface.'}{name}\n" in page
    with pytest.raises(AttributeError, match="has no attribute 'walk'"):
        labctl.walk  # noqa: B018


def test_two_of_the_functions_are_packages_too() -> None:
    code = (
        "import labctl.bench.station, labctl.runs.index, labctl; "
        "print(callable(labctl.bench), callable(labctl.runs), labctl.runs(folder='nowhere'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "True True []\n"


def test_a_bench_in_ones_hands_is_lit_by_the_first_trace_and_dark_at_its_end() -> None:
    image = np.eye(28)
    with labctl.bench() as bench:
        bench.show(image)
        bright = bench.capture(window="1 ns", ports=[2, 3])
        assert (bright.volts.shape, bright.ports) == ((2, 25), (2, 3))
        assert not bright.clipped.any()
        assert bright.origin is Origin.SIMULATED
        assert bright.time_s[-1] == pytest.approx(24 * 40e-12)
        bench.laser.power = "10 mW"
        dim = bench.capture(window="1 ns", ports=[2, 3])
        assert bench.laser.power == 0.01
        assert 1.5 < bright.volts.mean() / dim.volts.mean() < 4
        bench.blank()
        assert bench.capture(window="1 ns", ports=[2, 3]).volts.mean() < 0.3 * dim.volts.mean()
        bench.laser.wavelength = "1551 nm"
        assert bench.laser.wavelength == pytest.approx(1551, abs=0.01)
        bench.dark()
        bench.show(image)
        bench.capture()


def test_what_was_shown_is_shown_again_when_there_is_light_again() -> None:
    with labctl.bench() as bench:
        bench.show(np.ones((10, 10)))
        bright = bench.capture().volts.mean()
        bench.dark()
        assert bench.capture().volts.mean() > 0.8 * bright
        bench.dark()
        bench.blank()
        assert bench.capture().volts.mean() < 0.3 * bright


def test_the_light_goes_out_whatever_ends_the_block() -> None:
    light = Emission()

    def fail(bench: Hands) -> None:
        bench.show(np.ones((10, 10)))
        bench.capture()
        raise ZeroDivisionError

    with (
        pytest.raises(ZeroDivisionError),
        in_hands(SIMULATED_STATION, Access(), wavelength_nm=1550.0, drive_seed=1, observer=light) as bench,
    ):
        fail(bench)
    assert light.seen == [True, False]


def _cable_out(*_arguments: object) -> None:
    raise LinkError("cannot be reached")


def _went_out(_laser: Tlg220) -> None:
    raise LightLost("laser: the light went out by itself")


class HeardBench(VisitedBench):
    """Remembers what each instrument was sent, and that it was."""

    def __init__(self) -> None:
        super().__init__()
        self.heard: list[tuple[str, Message]] = []

    def hears(self, role: str, message: Message) -> None:
        self.heard.append((role, message))


@pytest.fixture
def visited(tmp_path: Path) -> Iterator[tuple[HeardBench, Path]]:
    """A served bench that somebody else can speak to, and its station file."""
    file = tmp_path / "bench.toml"
    with HeardBench() as simulated:
        hasty = Station.model_validate({"scope": {"timeout": "1 s"}})
        write_addresses(file, {role: found["socket"] for role, found in simulated.resources.items()}, hasty)
        yield simulated, file


def test_a_trace_that_fails_because_of_a_changed_setting_says_so(visited: tuple[HeardBench, Path]) -> None:
    simulated, file = visited
    with labctl.bench(file, armed=True) as bench:
        bench.show(np.ones((10, 10)))
        bench.capture()
        simulated.say("awg", b"OUTPut1 OFF")
        with pytest.raises(SettingChanged, match="awg: OUTPut1:STATe was 1 and is 0"):
            bench.capture()


def test_after_a_changed_setting_the_next_trace_has_its_ranges_again(visited: tuple[HeardBench, Path]) -> None:
    simulated, file = visited
    with labctl.bench(file, armed=True) as bench:
        bench.show(np.ones((10, 10)))
        before = bench.capture()
        simulated.say("scope", b"CH1:SCAle 0.4")
        with pytest.raises(SettingChanged, match="scope: CH1:SCAle was"):
            bench.require_unchanged()
        assert bench.capture().scalings[0].scale_v == pytest.approx(before.scalings[0].scale_v, rel=0.1)


def _set_power(bench: Hands) -> None:
    bench.laser.power = "20 mW"


def _tune(bench: Hands) -> None:
    bench.laser.wavelength = "1551 nm"


def _stop_drive(bench: Hands) -> None:
    bench.drive = False


@pytest.mark.parametrize(
    ("driver", "method", "does", "act", "error"),
    [
        (Dpo72504dx, "arm", _cable_out, Hands.capture, LinkError),
        (Tlg220, "require_emission", _went_out, Hands.capture, LightLost),
        (Tlg220, "set_power", lambda _laser, _power_w: 0.05, _set_power, OverLimit),
        (Tlg220, "power", lambda _laser: 0.05, Hands.require_unchanged, OverLimit),
        (Dpo72504dx, "changes", _cable_out, Hands.require_unchanged, LinkError),
        (Tlg220, "tune", _cable_out, _tune, LinkError),
        (Awg70002a, "stop", _cable_out, _stop_drive, LinkError),
        (VialuxAlp, "show", _cable_out, lambda bench: bench.show(np.eye(10)), LinkError),
        (VialuxAlp, "blank", _cable_out, Hands.blank, LinkError),
    ],
    ids=["trace", "light", "power", "more power", "comparison", "wavelength", "drive", "show", "blank"],
)
def test_who_catches_an_error_has_no_light_on(
    driver: type,
    method: str,
    does: Any,
    act: Callable[[Hands], None],
    error: type[Exception],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    light = Emission()
    with in_hands(SIMULATED_STATION, Access(), wavelength_nm=1550.0, drive_seed=1, observer=light) as bench:
        bench.show(np.ones((10, 10)))
        bench.capture()
        with monkeypatch.context() as broken:
            broken.setattr(driver, method, does)
            with pytest.raises(error):
                act(bench)
            assert light.seen == [True, False]
        bench.capture()
    assert light.seen == [True, False, True, False]


def test_a_bench_whose_block_has_ended_is_closed_and_sends_nothing(visited: tuple[HeardBench, Path]) -> None:
    simulated, file = visited
    with labctl.bench(file, armed=True) as closed:
        closed.show(np.ones((10, 10)))
        closed.capture()
    acts: list[Callable[[Hands], object]] = [
        lambda bench: bench.show(np.eye(10)),
        Hands.blank,
        Hands.capture,
        Hands.dark,
        Hands.require_unchanged,
        Hands.require_supervision,
        lambda bench: bench.drive,
        _stop_drive,
        lambda bench: bench.laser.power,
        _set_power,
        lambda bench: bench.laser.wavelength,
        _tune,
    ]
    with labctl.bench(file, armed=True) as another:
        another.show(np.ones((10, 10)))
        another.capture()
        first = len(simulated.heard)
        another.capture()
        second = len(simulated.heard)
        for act in acts:
            with pytest.raises(LabctlError, match=r"^this bench is closed .*, nothing was sent: open it again: .*$"):
                act(closed)
        another.capture()
        assert simulated.heard[second:] == simulated.heard[first:second] != []


@pytest.mark.parametrize(
    ("power", "told"),
    [
        ("40 mW", "laser.power = 40 mW exceeds limits.optical_power = 30 mW"),
        ("-3 mW", "laser.power = -3 mW is no power of a laser: choose one above 0"),
        (0, "laser.power = 0 mW is no power of a laser"),
        (float("nan"), "laser.power = nan mW is no power of a laser"),
        ("3", "has no unit"),
        ("3 nm", "not in W"),
    ],
)
def test_powers_that_are_refused_change_nothing(power: str | float, told: str) -> None:
    with labctl.bench() as bench:
        with pytest.raises((OutOfRange, ValueError), match=told):
            bench.laser.power = power
        assert bench.laser.power == 0.03


def test_a_power_that_the_laser_does_not_give_leaves_its_light_on() -> None:
    light = Emission()
    station = Station.model_validate({"laser": {"driver": "santec-tsl-570", "power": "10 mW"}})
    with in_hands(station, Access(), wavelength_nm=1550.0, drive_seed=1, observer=light) as bench:
        bench.show(np.ones((10, 10)))
        bench.capture()
        with pytest.raises(OutOfRange, match=r"laser power = 13\.9794 dBm is outside"):
            bench.laser.power = "25 mW"
        assert (light.seen, bench.laser.power) == ([True], 10e-3)


def test_what_a_hand_cannot_do() -> None:
    with labctl.bench() as bench:
        with pytest.raises(OutOfRange, match="5 ports at once: the bench has 4 channels"):
            bench.capture(ports=range(2, 7))
        with pytest.raises(OutOfRange, match=r"2 ports at once: .* port 0 is measured alone"):
            bench.capture(ports=(0, 2))
        with pytest.raises(OutOfRange, match="choose 4e-11 to 2e-05 s"):
            bench.capture(window="1 ps")
        for no_image in ([1, 2], np.zeros((0, 0)), np.zeros((5, 0))):
            with pytest.raises(OutOfRange, match="show one of rows and columns"):
                bench.show(no_image)


def test_from_images_in_to_accuracy_out(tmp_path: Path) -> None:
    outcome = labctl.run(images=60, window="0.4 ns", out=tmp_path / "runs" / "one")
    assert (outcome.complete, outcome.directory) == (True, tmp_path / "runs" / "one")
    with pytest.raises(LabctlError, match=r"no port is chosen: choose from \(2, 3, 4, 5, 6\)"):
        labctl.train(outcome.directory, ports=())
    trained = labctl.train(outcome.directory, ports=[2, 3], out=tmp_path / "model.h5")
    assert trained["ports"] == [2, 3]
    assert labctl.evaluate(trained["model"], outcome.directory)["test_shots"] == trained["test_shots"]
    [found] = labctl.runs("images = 60", folder=tmp_path / "runs")
    assert found.row.path == outcome.directory

    measured = labctl.sweep(
        "image-readout", {"averages": ["1", "2"]}, images=40, window="0.4 ns", ports=[2], out=tmp_path / "sweep"
    )
    assert (measured.runs, measured.complete) == (3, 3)
    assert len(labctl.evaluate(tmp_path / "sweep")["points"]) == 3


def test_a_sweep_takes_the_settings_that_a_run_takes(tmp_path: Path) -> None:
    measured = labctl.sweep(
        "image-readout",
        {"averages": range(1, 3)},
        images=np.int64(10),
        window="0.4 ns",
        ports=np.array([2, 3]),
        classes=range(2),
        reference_every=0,
        out=tmp_path / "sweep",
    )
    assert (measured.runs, measured.complete) == (2, 2)
    kept = read(measured.directory).sweep
    assert kept.settings == {"images": 10, "window": 0.4e-9, "ports": [2, 3], "classes": [0, 1]}
    assert kept.over == {"averages": ("1", "2")}


@pytest.mark.parametrize(
    ("over", "more", "told"),
    [
        ({}, {}, "over = {}: Dictionary should have at least 1 item"),
        ({"power": []}, {}, r"over.power = \[\]: Tuple should have at least 1 item"),
        (None, {}, "over = None: Input should be a valid dictionary"),
        ({"averages": 2}, {}, "over.averages = 2: Input should be a valid tuple"),
        ({"power": [0.01]}, {}, "'0.01' has no unit: write it like '0.01 W'"),
        ({"power": ["10 mW"]}, {"order": "backwards"}, "order = 'backwards': Input should be 'random'"),
        ({"power": ["10 mW"]}, {"reference_every": -1}, "reference_every = -1: Input should be greater"),
    ],
)
def test_what_is_no_sweep_is_refused_in_one_line_and_leaves_no_folder(
    over: Any, more: dict[str, Any], told: str, tmp_path: Path
) -> None:
    with pytest.raises(LabctlError, match=told) as raised:
        labctl.sweep("image-readout", over, images=10, out=tmp_path / "sweep", **more)
    assert "\n" not in str(raised.value)
    assert not (tmp_path / "sweep").exists()


def test_a_run_in_the_place_of_the_model_is_not_to_be_removed(tmp_path: Path) -> None:
    (run := tmp_path / "mine").mkdir()
    with pytest.raises(LabctlError, match="mine: is a folder: name the model file first, then the run directory"):
        labctl.evaluate(run, tmp_path / "m.h5")


def test_errors_are_those_of_the_commands(tmp_path: Path) -> None:
    with pytest.raises(LabctlError, match="image-readout has no such setting"):
        labctl.run(colour="red")
    with pytest.raises(StationError), labctl.bench(tmp_path / "nowhere.toml"):
        pass
    with pytest.raises(RunError):
        labctl.train(tmp_path / "nowhere")
