"""Amplifier and attenuator behind the laser: their interlocks, in the order in which the instruments are told."""

import io
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from instruments.bench import Bench
from instruments.errors import InstrumentError, LightLost, NotConfigured, OutOfRange, SettingChanged
from instruments.interfaces import BYPASS_PORT
from instruments.limits import OverLimit
from instruments.manual_patch_panel import ManualPatchPanel
from instruments.safe_state import UnsafeBench
from instruments.table_attenuator import SIMULATED_TABLE
from instruments.values import Drive, Timebase, Vertical
from instruments.visa import VisaLink
from labctl.bench.check import check_bench
from labctl.bench.opening import OpenBench, opened
from labctl.bench.simulation import with_laser_commands
from labctl.bench.station import Station
from labctl.bench.supervisor import Task, supervise, within_reach
from labctl.errors import StationError
from sim_backends.bench import SimulatedBench

AMPLIFIER = {"driver": "table-amplifier", "commands": "simulated", "power": "100 mW"}
ATTENUATOR = {"driver": "table-attenuator", "commands": "simulated", "attenuation_db": 3.0}
METER = {"driver": "thorlabs-pm100", "tap": 0.01}


def station(**more: Any) -> Station:
    linear = {"parameters": {"amplifier_saturation_w": 1e3, "detector_gain_v_per_w": 60.0}}
    found = {"power_meter": METER, "amplifier": AMPLIFIER, "attenuator": ATTENUATOR, "sim": linear} | more
    return Station.model_validate({key: value for key, value in found.items() if value is not None})


@pytest.fixture
def open_bench(log: Any) -> Iterator[OpenBench]:
    with opened(station(), log) as found:
        yield found


@pytest.fixture
def front_panel(simulation: SimulatedBench, log: Any) -> Iterator[VisaLink]:
    """Of the amplifier."""
    link = VisaLink(simulation.resources["amplifier"]["socket"], name="they", timeout_s=5, transcript=log)
    yield link
    link.close()


def switched(log: Any) -> list[str]:
    """What was switched, in order; the same again is left out."""
    told = [
        f"{name} {text.split()[-1]}"
        for name, direction, text in log.messages
        if direction == ">" and name in ("laser", "amplifier", "attenuator") and text.upper().startswith("OUTPUT O")
    ]
    return [one for place, one in enumerate(told) if told[place - 1 : place] != [one]]


def mean_trace(bench: Bench) -> float:
    """Volts behind the fibre before the chip, every mirror on, without a drive."""
    bench.connect({1: BYPASS_PORT})
    bench.dmd.show(np.full((768, 128), 255, np.uint8))
    bench.awg.load(Drive("still", np.zeros(2500, np.float32), 25e9, 0.5))
    bench.play_drive()
    bench.configure(Timebase(25e9, 500), (1,), 16)
    bench.scope.set_vertical(1, Vertical(0.02, 0.08))
    frames = bench.capture()
    (scaling,) = bench.scope.scalings()
    return float(frames.codes.mean()) * scaling.scale_v + scaling.offset_v


def test_light_up_and_dark_come_in_their_order(bench: Bench, log: Any) -> None:
    with bench.emitting(1550.0):
        assert switched(log) == ["attenuator OFF", "amplifier OFF", "laser ON", "amplifier ON", "attenuator ON"]
        log.messages.clear()
    assert switched(log) == ["attenuator OFF", "amplifier OFF", "laser OFF"]


def test_no_amplifier_is_on_while_the_laser_tunes(bench: Bench, log: Any) -> None:
    with bench.emitting(1550.0):
        log.messages.clear()
        bench.tune(1551.0)
        assert switched(log) == ["attenuator OFF", "amplifier OFF", "amplifier ON", "attenuator ON"]


def test_no_light_is_on_while_a_person_moves_fibres(bench: Bench, front_panel: VisaLink, log: Any) -> None:
    """The amplifier is off before its seed is, and comes back after it."""
    seen: list[tuple[bool, float, str]] = []

    def operator(_request: str) -> str:
        seen.append((bench.lit, float(bench.laser.settings()["emitting"]), front_panel.query("OUTPut?")))
        return ""

    bench.patch_panel = ManualPatchPanel(operator, ports=(2, 3))
    with bench.emitting(1550.0, {1: 2}):
        assert len(seen) == 1
        bench.connect({1: 2})
        bench.require_unchanged()
        log.messages.clear()
        bench.connect({1: 3})
        bench.require_unchanged()
        dark, lit = ["attenuator OFF", "amplifier OFF", "laser OFF"], ["laser ON", "amplifier ON", "attenuator ON"]
        assert switched(log) == [*dark, "attenuator OFF", "amplifier OFF", *lit]
    assert seen == [(False, 0, "0")] * 2


def test_nobody_is_asked_to_move_fibres_while_the_laser_may_emit(bench: Bench, simulation: SimulatedBench) -> None:
    asked: list[str] = []

    def operator(request: str) -> str:
        asked.append(request)
        return ""

    bench.patch_panel = ManualPatchPanel(operator, ports=(2, 3))

    def measure() -> None:
        with bench.emitting(1550.0, {1: 2}):
            asked.clear()
            simulation.stop()
            bench.connect({1: 3})

    with pytest.raises(UnsafeBench, match="key switch"):
        measure()
    assert not asked


def test_nobody_is_asked_to_move_fibres_for_light_that_is_refused(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def operator(request: str) -> str:
        asked.append(request)
        return ""

    def refuse() -> None:
        raise UnsafeBench("the supervisor has ended")

    def measure() -> None:
        with bench.emitting(1550.0, {1: 2}):
            monkeypatch.setattr(bench.observer, "before_light", refuse)
            bench.connect({1: 3})

    bench.patch_panel = ManualPatchPanel(operator, ports=(2, 3))
    for _ in range(2):  # in the light of another patching, and before any
        with pytest.raises(UnsafeBench, match="supervisor"):
            measure()
    assert len(asked) == 1
    assert bench.laser.settings()["emitting"] == 0


def test_what_a_person_is_asked_in_vain_is_told_as_that(bench: Bench) -> None:
    """Not as light that went out."""

    def nobody(request: str) -> str:
        raise InstrumentError(f"nobody answered {request!r}")

    def measure() -> None:
        with bench.emitting(1550.0):
            bench.patch_panel = ManualPatchPanel(nobody, ports=(2, 3))
            bench.connect({1: 2})

    with pytest.raises(InstrumentError, match="nobody answered"):
        measure()
    assert bench.laser.settings()["emitting"] == 0


def test_the_world_amplifies_and_attenuates(bench: Bench, simulation: SimulatedBench) -> None:
    amplifier, attenuator = bench.train.amplifier, bench.train.attenuator
    assert amplifier is not None
    assert attenuator is not None
    with bench.emitting(1550.0):
        assert amplifier.power() == pytest.approx(0.1, rel=1e-3)
        assert amplifier.power() == pytest.approx(simulation.world.amplified_power_w)
        bright = mean_trace(bench)
        found = attenuator.open(6.0)
        assert found == 6
        assert mean_trace(bench) == pytest.approx(bright * 10**-0.3, rel=0.05)
        amplifier.set_power(50e-3)
        assert mean_trace(bench) == pytest.approx(bright * 10**-0.6, rel=0.05)


def test_both_are_checked_noted_and_kept(bench: Bench, front_panel: VisaLink) -> None:
    found = check_bench(station(), lambda *_: None)
    assert list(found) == ["attenuator", "amplifier", "laser", "awg", "dmd", "scope", "patch_panel", "power_meter"]
    assert all(finding.ok for finding in found.values())
    assert found["amplifier"].allowed["amplifier.power"].high == 0.2
    with bench.emitting(1550.0):
        settings = {name: instrument.settings() for name, instrument in bench.instruments.items()}
        assert settings["amplifier"]["power_dbm"] == 20
        assert (settings["attenuator"]["attenuation_db"], settings["attenuator"]["open"]) == (3, 1)
        bench.require_unchanged()
        front_panel.write("POWer:LEVel 19")
        with pytest.raises(SettingChanged, match="amplifier: power was 20 and is 19"):
            bench.require_unchanged()


@pytest.mark.parametrize(
    ("role", "told"),
    [("amplifier", "amplifier: is off and was on"), ("attenuator", "attenuator: is shut and was open")],
)
def test_light_that_somebody_else_stopped_is_missed(
    role: str, told: str, bench: Bench, simulation: SimulatedBench, log: Any
) -> None:
    panel = VisaLink(simulation.resources[role]["socket"], name="they", timeout_s=5, transcript=log)
    with closing(panel), bench.emitting(1550.0):
        bench.require_unchanged()
        panel.write("OUTPut OFF")
        with pytest.raises(LightLost, match=told):
            bench.require_unchanged()
    bench.require_unchanged()


def test_more_than_may_leave_the_amplifier_is_dark(bench: Bench, front_panel: VisaLink) -> None:
    with bench.emitting(1550.0):
        front_panel.write("POWer:LEVel 24")
        with pytest.raises(OverLimit, match=r"amplifier: gives 251\.2 mW, above limits\.amplified_power = 200 mW"):
            bench.require_unchanged()


def test_more_is_refused_before_anything_is_sent(log: Any) -> None:
    too_much = station(amplifier=AMPLIFIER | {"power": "300 mW"})
    with (
        pytest.raises(OutOfRange, match=r"amplifier\.power = 300 mW exceeds limits\.amplified_power = 200 mW"),
        opened(too_much, log),
    ):
        raise AssertionError("opened")
    assert not log.messages


def test_without_its_seed_the_amplifier_stays_off(
    bench: Bench, simulation: SimulatedBench, log: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulation.world, "emit", lambda *_, **__: None)  # the fibre to the tap is off
    with pytest.raises(InstrumentError, match="power_meter: sees 0 mW of the laser"), bench.emitting(1550.0):
        raise AssertionError("lit")
    assert "amplifier ON" not in switched(log)


def test_every_other_one_is_made_safe_and_an_amplifier_that_goes_on_is_told(
    bench: Bench, log: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stuck() -> None:
        raise InstrumentError("amplifier: stuck")

    monkeypatch.setattr(bench.train.amplifier, "make_safe", stuck)
    with pytest.raises(UnsafeBench, match=r"the laser is off; the amplifier may still emit, switch it off") as failure:
        bench.make_safe()
    assert failure.value.disobeyed == {"amplifier"}
    assert switched(log) == ["attenuator OFF", "laser OFF"]


def without_shutter(folder: Path) -> Station:
    """A bench whose attenuator is shut at its largest attenuation."""
    kept, rest = SIMULATED_TABLE.read_text("utf-8").split("[commands.open]")
    error = rest[rest.index("[commands.error]") :]
    table = folder / "voa.toml"
    table.write_text(f'{kept}[commands.shut]\nwrite = "INPut:ATTenuation 60"\n{error}', "utf-8")
    return station(amplifier=None, attenuator=ATTENUATOR | {"commands": table})


def test_an_attenuator_without_a_shutter_is_shut_at_its_largest_attenuation(tmp_path: Path, log: Any) -> None:
    with opened(without_shutter(tmp_path), log) as found:
        bench, attenuator = found.bench, found.bench.instruments["attenuator"]
        bench.make_safe()
        bench.require_unchanged()
        with bench.emitting(1550.0):
            assert (attenuator.settings()["attenuation_db"], attenuator.settings()["open"]) == (3, 1)
            bench.tune(1551.0)
            bench.require_unchanged()
        assert (attenuator.settings()["attenuation_db"], attenuator.settings()["open"]) == (60, 0)
        bench.require_unchanged()
    assert not [text for text in log.sent_to("attenuator") if text.startswith("OUTPut")]


def test_without_a_shutter_the_largest_attenuation_must_be_known(tmp_path: Path, log: Any) -> None:
    unknown = without_shutter(tmp_path)
    table = tmp_path / "voa.toml"
    table.write_text(table.read_text("utf-8").replace("max = 60.0\n", ""), "utf-8")
    with (
        pytest.raises(StationError, match=r"voa\.toml: commands\.set_attenuation\.max is missing: without get_open"),
        opened(unknown, log),
    ):
        raise AssertionError("opened")


def test_a_table_is_needed_complete_and_verified(tmp_path: Path, log: Any) -> None:
    table = tmp_path / "edfa.toml"
    for commands, message in (
        (None, r"amplifier\.commands is missing: name the file"),
        (table, r"edfa\.toml: commands\.set_power\.write = '<unknown>': enter the command from the amplifier's manual"),
    ):
        table.write_text(
            'model = "x"\nverified = false\n[commands.identify]\nwrite = "*IDN?"\nreply = "(?P<text>.+)"\n', "utf-8"
        )
        section = AMPLIFIER | {"commands": commands}
        with pytest.raises((StationError, NotConfigured), match=message), opened(station(amplifier=section), log):
            raise AssertionError("opened")


def test_a_bench_without_them_asks_nothing_more(log: Any) -> None:
    with opened(Station(), log) as found, found.bench.emitting(1550.0):
        found.bench.require_unchanged()
    assert {name for name, _, _ in log.messages} <= {"laser", "awg", "dmd", "scope", "patch_panel"}


def test_the_supervisor_makes_them_safe_in_the_same_order(log: Any, capfd: pytest.CaptureFixture[str]) -> None:
    with opened(station(), log) as found:
        assert found.simulation is not None
        there = with_laser_commands(station())
        served = there.model_copy(
            update={
                name: there.section_of(name).model_copy(update={"address": at["socket"]})
                for name, at in found.simulation.resources.items()
            }
        )
        assert within_reach(served) == ("attenuator", "amplifier", "laser", "awg", "dmd", "scope")
        for name in ("laser", "amplifier"):
            link = VisaLink(served.section_of(name).address, name=name, timeout_s=5, transcript=log)
            link.write("OUTPUT ON")
            link.close()
        task = Task(station=served, log_started=0.0)
        supervise(io.BytesIO(f"{task.model_dump_json()}\n".encode()), lambda _word: None)
        assert found.bench.laser.settings()["emitting"] == 0
        assert found.bench.instruments["amplifier"].settings()["on"] == 0
    assert "the supervisor did: attenuator shut, amplifier off, laser off, AWG output off" in capfd.readouterr().err
