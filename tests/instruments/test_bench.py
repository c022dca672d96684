"""Safe state, limits and passes."""

import re
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, nullcontext
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from instruments.bench import Bench
from instruments.errors import InstrumentError, LightLost, LinkError, NotConfigured, OutOfRange, SettingChanged
from instruments.interfaces import BYPASS_PORT, Instrument
from instruments.limits import Limits, OverLimit
from instruments.safe_state import UnsafeBench
from instruments.values import Drive, Scaling
from instruments.vialux_alp import VialuxAlp
from instruments.visa import VisaLink
from labctl.bench.opening import Access, opened
from labctl.bench.simulation import SIMULATED_LASER
from labctl.bench.station import LimitsSection, Station
from labctl.engine.session import Acquisition, acquire
from labctl.errors import StationError
from labctl.runs.live.logs import CommandLog
from protocols.image_readout import ImageReadout
from sim_backends.bench import SimulatedBench
from sim_backends.virtual import VirtualTlg220


def test_light_only_inside_emitting(bench: Bench) -> None:
    with bench.emitting(1550.0):
        assert bench.laser.settings()["emitting"] == 1
    assert bench.laser.settings()["emitting"] == 0


def test_dark_after_a_failure(bench: Bench) -> None:
    with pytest.raises(RuntimeError, match="fault"), bench.emitting(1550.0):
        raise RuntimeError("fault")
    assert bench.laser.settings()["emitting"] == 0


def failing_once(bench: Bench, simulation: SimulatedBench, said: Mapping[str, str]) -> None:
    """Measure, and fail when another client has said something to each of some instruments, by role."""
    drive = Drive("square", np.tile(np.array([-1, 1], np.float32), 1200), sample_rate=25e9, amplitude_vpp=0.5)
    with bench.emitting(1550.0), ExitStack() as stack:
        bench.load_drive(drive)
        bench.play_drive()
        for role, line in said.items():
            resource = simulation.resources[role]["socket"]
            other = VisaLink(resource, name="another client", timeout_s=5, transcript=lambda *_: None)
            stack.callback(other.close)
            other.write(line)
            other.query("*OPC?")
        raise InstrumentError("scope: no trigger came")


def test_a_setting_that_somebody_changed_is_the_reason_why_an_instrument_fails(
    bench: Bench, simulation: SimulatedBench
) -> None:
    with pytest.raises(SettingChanged, match="awg: OUTPut1:STATe was 1 and is 0"):
        failing_once(bench, simulation, {"awg": "OUTPut1 OFF"})


def test_light_that_somebody_switched_off_is_told_before_a_setting_that_was_changed(
    bench: Bench, simulation: SimulatedBench
) -> None:
    """After a setting that was changed a run goes on, with light."""
    with pytest.raises(LightLost, match="the light went out by itself"):
        failing_once(bench, simulation, {"awg": "OUTPut1 OFF", "laser": "OUTPUT OFF"})


def test_an_instrument_that_fails_by_itself_tells_its_own_error(bench: Bench, simulation: SimulatedBench) -> None:
    with pytest.raises(InstrumentError, match="scope: no trigger came"):
        failing_once(bench, simulation, {"awg": "*CLS"})


def test_the_safe_state_comes_in_its_order(bench: Bench, log: Any) -> None:
    bench.make_safe()
    order = list(dict.fromkeys(name for name, _, _ in log.messages))
    assert order == ["laser", "awg", "dmd", "scope"]


def test_every_instrument_is_tried_when_one_fails(bench: Bench, simulation: SimulatedBench, log: Any) -> None:
    simulation.stop()
    with pytest.raises(UnsafeBench, match=r"laser: .*awg: .*dmd: .*scope: .*key switch"):
        bench.make_safe()


def test_every_instrument_is_made_safe_whatever_one_of_them_raises(
    bench: Bench, log: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A driver that fails is told as one whose instrument did not obey: its light may be on."""
    heard: list[UnsafeBench | None] = []

    def garbled() -> None:
        raise ValueError("no\nnumber")

    def measure() -> None:
        with bench.emitting(1550.0):
            log.messages.clear()
            monkeypatch.setattr(bench.laser, "make_safe", garbled)
            monkeypatch.setattr(bench.observer, "safe_state", heard.append)

    with pytest.raises(UnsafeBench, match=r"laser: ValueError: no number.*key switch") as failure:
        measure()
    assert isinstance(failure.value.__cause__, ValueError)
    assert list(dict.fromkeys(name for name, _, _ in log.messages)) == ["awg", "dmd", "scope"]
    assert heard == [failure.value], "the supervisor has to see to it"


def test_the_first_error_is_told_and_the_unsafe_bench_beside_it(bench: Bench, simulation: SimulatedBench) -> None:
    def measure() -> None:
        with bench.emitting(1550.0):
            simulation.stop()
            raise RuntimeError("fault")

    with pytest.raises(RuntimeError, match="fault") as failure:
        measure()
    (note,) = failure.value.__notes__
    assert re.search(r"the safe state is not confirmed .*key switch", note)


def test_an_unsafe_bench_is_an_error_of_its_own_where_there_is_no_other(
    bench: Bench, simulation: SimulatedBench
) -> None:
    def measuring() -> Iterator[None]:
        with bench.emitting(1550.0):
            yield

    abandoned = measuring()
    next(abandoned)
    simulation.stop()
    with pytest.raises(UnsafeBench, match="key switch"):
        abandoned.close()  # type: ignore[attr-defined]


def test_every_connection_is_closed_when_some_fail(log: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    closed = []

    def failing(name: str, instrument: Instrument, error: Exception | None) -> Callable[[], None]:
        release = instrument.close

        def close() -> None:
            release()
            closed.append(name)
            if error is not None:
                raise error

        return close

    def measure() -> None:
        with opened(Station(), log) as found:
            for name, instrument in found.bench.instruments.items():
                error = {"awg": InstrumentError("awg: stuck"), "scope": OSError("scope: odd")}.get(name)
                monkeypatch.setattr(instrument, "close", failing(name, instrument, error))
            raise LinkError("scope is gone")

    with pytest.raises(LinkError, match="scope is gone") as failure:
        measure()
    assert closed == ["laser", "awg", "dmd", "scope", "patch_panel"]
    assert failure.value.__notes__ == ["awg: stuck", "scope: odd"]


def test_a_connection_that_cannot_be_released_is_told(log: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    close = VialuxAlp.close

    def stuck(dmd: VialuxAlp) -> None:
        close(dmd)
        raise InstrumentError("dmd: stuck")

    monkeypatch.setattr(VialuxAlp, "close", stuck)
    with pytest.raises(InstrumentError, match="dmd: stuck"), opened(Station(), log) as found:
        found.bench.dmd.identify()


def test_five_ports_need_two_passes(bench: Bench) -> None:
    assert bench.patchings_for((2, 3, 4, 5, 6)) == ({1: 2, 2: 3, 3: 4, 4: 5}, {1: 6})


@pytest.mark.parametrize(
    ("ports", "passes"),
    [
        ((0,), [(0,)]),
        ((0, 2), [(0,), (2,)]),
        ((0, 2, 3, 4, 5, 6), [(0,), (2, 3, 4, 5), (6,)]),
        ((2, 0, 3), [(2, 3), (0,)]),
        ((2, 3, 0, 4, 5, 6), [(2, 3, 4, 5), (0,), (6,)]),
    ],
)
def test_the_fibre_before_the_chip_has_a_pass_of_its_own(
    ports: tuple[int, ...], passes: list[tuple[int, ...]], bench: Bench
) -> None:
    patchings = bench.patchings_for(ports)
    assert [tuple(patching.values()) for patching in patchings] == passes
    assert all(min(patching) == 1 for patching in patchings)


def test_a_port_that_is_not_patched(bench: Bench) -> None:
    with pytest.raises(OutOfRange, match="port 10 is not patched"):
        bench.patchings_for((2, 10))


def test_a_bypassed_chip_has_one_fibre() -> None:
    with CommandLog() as log, opened(Station(patch_panel={"bypass": True}), log) as found:
        assert found.bench.patchings_for((2, 3, 4, 5, 6)) == ({1: BYPASS_PORT},)


@pytest.mark.parametrize("driver", ["scpi-fibre-switch", "manual-patch-panel"])
def test_a_fibre_that_is_plugged_in_for_good_is_neither_routed_nor_asked_for(
    driver: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The panel carries the ports of the chip alone."""
    asked: list[str] = []
    monkeypatch.setattr("labctl.bench.opening.ask_operator", asked.append)
    panel = {"driver": driver, "ports": (2, 3, 4, 5, 6), "bypass": True}
    protocol = ImageReadout(images=4, window=0.8e-9)
    for channels in ((1, 2, 3, 4), (2, 4)):
        station = Station(mixed=True, patch_panel=panel, scope={"channels": channels})
        assert acquire(Acquisition(protocol, station, tmp_path / str(channels[0]))).outcome.complete
    assert not asked


@pytest.mark.parametrize(
    ("station", "message"),
    [
        (Station(laser={"power": 0.05}), r"laser.power = 50 mW exceeds limits.optical_power = 30 mW"),
        (Station(limits=LimitsSection(rf_amplitude=0.3)), r"awg.amplitude = 0.5 V exceeds limits.rf_amplitude = 0.3 V"),
        (
            Station(awg={"amplitude": 0.6}, limits=LimitsSection(rf_amplitude=1.0)),
            r"awg.amplitude = 0.6 Vpp is outside 0.25..0.5 Vpp",
        ),
        (Station(laser={"driver": "manual-laser"}), r"manual-laser.*key switch is the only interlock"),
        (Station(mixed=True, laser={"address": "TCPIP0::127.0.0.1::9::SOCKET"}), r"commands\.\w+\.write = '<unknown>'"),
    ],
)
def test_a_wrong_station_is_refused_before_any_message(station: Station, message: str, log: Any) -> None:
    with pytest.raises((StationError, OutOfRange), match=f"built-in station: .*{message}"), opened(station, log):
        pass
    assert not log.messages


def test_an_address_that_does_not_answer(log: Any) -> None:
    station = Station(
        mixed=True, awg=Station().awg.model_copy(update={"address": "TCPIP0::127.0.0.1::9::SOCKET", "timeout": 0.5})
    )
    with opened(station, log) as found, pytest.raises(InstrumentError, match=r"awg at TCPIP0::127.0.0.1::9::SOCKET"):
        found.bench.awg.identify()


def test_the_clock_of_a_real_bench_does_not_go_back_when_that_of_the_wall_does(
    log: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    station = Station(mixed=True, scope=Station().scope.model_copy(update={"address": "TCPIP0::127.0.0.1::9::SOCKET"}))
    wall = iter([7200.0, 3600.0])
    monkeypatch.setattr(time, "time", lambda: next(wall))
    with opened(station, log) as found:
        before = found.bench.now()
        assert 0 <= found.bench.now() - before < 3600


def test_a_bench_that_is_not_armed_says_nothing_to_its_laser(log: Any) -> None:
    laser = {"address": "TCPIP0::127.0.0.1::9::SOCKET", "commands": SIMULATED_LASER}
    with (
        opened(Station(mixed=True, laser=laser), log) as found,
        pytest.raises(NotConfigured, match=r"not armed.*--arm"),
        found.bench.emitting(1550.0),
    ):
        pass
    assert not log.messages
    for station, armed in (
        (Station(mixed=True, laser=laser), True),
        (Station(mixed=True, laser=laser | {"armed": True}), False),
    ):
        with opened(station, log, Access(armed=armed)) as found:
            found.bench.require_arm()


@pytest.mark.parametrize(("phrase", "lit"), [("_set_power", False), ("_output_on", True)])
def test_a_laser_that_gives_a_little_more_than_the_limit(
    phrase: str, lit: bool, bench: Bench, log: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """2 % more is inside the tolerance for what was asked, since lasers round; a limit is a limit."""
    told = getattr(VirtualTlg220, phrase)

    def more(laser: Any, *words: Any) -> Any:
        reply = told(laser, *words)
        laser._power_w *= 1.02
        return reply

    monkeypatch.setattr(VirtualTlg220, phrase, more)
    message = r"laser: gives 30\.\d+ mW, above limits.optical_power = 30 mW"
    with pytest.raises(OverLimit, match=message), bench.emitting(1550.0):
        pass
    assert ("OUTPUT ON" in log.sent_to("laser")) is lit
    assert bench.laser.settings()["emitting"] == 0


def test_a_drive_above_the_limit_is_not_sent(log: Any) -> None:
    station = Station(awg={"amplitude": 0.4}, limits=LimitsSection(rf_amplitude=0.4))
    drive = Drive("d", np.zeros(2500, np.float32), 25e9, 0.5)
    with opened(station, log) as found, pytest.raises(OverLimit, match=r"awg: amplitude 0.5 V is above limits"):
        found.bench.load_drive(drive)
    assert not log.messages


@pytest.mark.parametrize(("answered", "told"), [(0.5, False), (0.5009, False), (0.5015, True), (float("nan"), True)])
def test_an_amplitude_that_was_read_back(answered: float, told: bool) -> None:
    limits = Limits(0.03, 0.5, 1.5)
    with pytest.raises(OverLimit) if told else nullcontext():
        limits.check_amplitude(answered)


def test_traces_are_compared_in_volts_on_either_side() -> None:
    limits = Limits(0.03, 0.5, 0.1)
    codes = np.zeros((3, 2, 50), np.int8)
    codes[1, 1, 7] = -90
    limits.check_traces((1, 4), codes, (Scaling(1e-3, 0.0), Scaling(1e-3, 0.0)))
    with pytest.raises(OverLimit, match=r"scope: CH4 shows -0.11 V, above limits.detector = 0.1 V"):
        limits.check_traces((1, 4), codes, (Scaling(1e-3, 0.0), Scaling(1e-3, -0.02)))
    with pytest.raises(OverLimit, match=r"CH1 shows 0.2 V"):
        limits.check_traces((1, 4), codes, (Scaling(1e-3, 0.2), Scaling(1e-3, 0.0)))
