"""The driver of the 6 Series B, through real sockets, against the virtual one."""

from collections.abc import Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest

from instruments.bench import Bench
from instruments.errors import InstrumentError, NoTrigger, OutOfRange, SettingChanged
from instruments.tektronix_mso6b import CODES_PER_DIVISION, Mso6b
from instruments.tektronix_mso6b_records import frame_offsets, frame_times
from instruments.values import Drive, EdgeTrigger, Timebase, Vertical
from instruments.visa import VisaLink
from labctl.bench.opening import OpenBench, opened
from labctl.bench.station import Station

AUX = EdgeTrigger("AUX", 0.5)
SHORT = Timebase(25e9, 50)


@pytest.fixture
def open_bench(log: Any) -> Iterator[OpenBench]:
    """A simulated bench with a 6 Series B."""
    with opened(Station.model_validate({"scope": {"driver": "tektronix-mso6b"}}), log) as found:
        yield found


@pytest.fixture
def second(open_bench: OpenBench, log: Any) -> Iterator[VisaLink]:
    """Another client of the same oscilloscope."""
    assert open_bench.simulation is not None
    link = VisaLink(open_bench.simulation.resources["scope"]["socket"], name="second", timeout_s=5, transcript=log)
    with closing(link):
        yield link


@pytest.fixture
def scope(bench: Bench) -> Mso6b:
    """The oscilloscope of a bench whose drive plays."""
    bench.awg.load(Drive("d", np.random.default_rng(0).uniform(-1, 1, 2500).astype(np.float32), 25e9, 0.5))
    bench.awg.play()
    bench.patch_panel.connect({1: 2, 2: 3})
    assert isinstance(bench.scope, Mso6b)
    return bench.scope


def test_a_record_is_the_first_points_of_a_longer_one(bench: Bench, scope: Mso6b) -> None:
    scope.configure(SHORT, AUX, (1, 2), 1)
    scope.set_vertical(1, Vertical(0.01, 0.0))
    frames = bench.capture()
    assert frames.codes.shape == (1, 2, 50)
    assert frames.codes.dtype == np.int16
    assert scope.settings()["record_length"] == 1000


def test_codes_are_twelve_bits_in_the_upper_ones_of_sixteen(bench: Bench, scope: Mso6b) -> None:
    scope.configure(SHORT, AUX, (1,), 1)
    scope.set_vertical(1, Vertical(0.01, 0.0))
    codes = bench.capture().codes
    assert np.unique(codes).size > 10
    assert not (codes % 16).any()
    (scaling,) = scope.scalings()
    assert scaling.scale_v == pytest.approx(0.01 / CODES_PER_DIVISION)


def test_both_ends_of_the_range_are_told(bench: Bench, scope: Mso6b) -> None:
    scope.configure(SHORT, AUX, (1,), 1)
    for offset_v in (1.0, -1.0):
        scope.set_vertical(1, Vertical(0.01, offset_v))
        assert bench.capture().clipped.all()
    scope.set_vertical(1, Vertical(0.5, 0.0))
    assert not bench.capture().clipped.any()


@pytest.mark.parametrize("averages", [1, 4])
def test_a_range_is_set_again_from_what_its_codes_mean(bench: Bench, scope: Mso6b, averages: int) -> None:
    scope.configure(SHORT, AUX, (1, 2), averages)
    for channel, vertical in ((1, Vertical(0.0123456789, 0.00123456789)), (2, Vertical(0.6, -0.98765432))):
        scope.set_vertical(channel, vertical)
    bench.capture()
    scalings = scope.scalings()
    for channel, scaling in zip((1, 2), scalings, strict=True):
        scope.set_vertical(channel, Vertical(0.1, 0.0))
        scope.set_vertical(channel, scope.vertical_for(scaling))
    bench.capture()
    assert scope.scalings() == scalings


def test_a_mean_is_of_every_trigger(bench: Bench, scope: Mso6b) -> None:
    """The noise of a mean of 64 falls to an eighth; its codes mean what those of a single trigger do."""
    volts = {}
    for averages in (1, 64):
        scope.configure(SHORT, AUX, (1,), averages)
        scope.set_vertical(1, Vertical(0.01, 0.0))
        codes = [bench.capture().codes[0, 0] for _ in range(8)]
        (scaling,) = scope.scalings()
        volts[averages] = np.array(codes) * scaling.scale_v + scaling.offset_v
    noise = {averages: found.std(axis=0).mean() for averages, found in volts.items()}
    assert noise[64] < noise[1] / 4
    assert np.abs(volts[1].mean(axis=0) - volts[64].mean(axis=0)).max() < 3 * noise[1]


def test_the_delay_is_that_of_the_first_sample(bench: Bench, scope: Mso6b) -> None:
    """Also off the sample grid: where the points lie then counts in the trigger's offset."""
    bench.laser.set_power(0.03)
    bench.laser.tune(1550.0)
    bench.laser.emit()
    bench.dmd.show(np.full((768, 128), 255, np.uint8))
    later = Timebase(25e9, 50, 20 / 25e9)
    traces = {}
    for timebase in (Timebase(25e9, 100), later):
        scope.configure(timebase, AUX, (1,), 64)
        scope.set_vertical(1, Vertical(0.1, 0.0))
        traces[timebase.samples] = bench.capture().codes[0, 0].astype(np.float64)
    assert np.corrcoef(traces[100][20:70], traces[50])[0, 1] > 0.9
    scope.configure(Timebase(25e9, 50, 20.4 / 25e9), AUX, (1,), 1)
    assert bench.capture().trigger_offset_s == pytest.approx(-0.4 / 25e9, abs=1e-13)
    scope.arm_burst(3)
    assert scope.read_burst().trigger_offset_s == pytest.approx(np.full((3, 1), -0.4 / 25e9), abs=1e-13)


def test_a_burst_is_one_frame_a_trigger(scope: Mso6b) -> None:
    scope.configure(SHORT, AUX, (1, 2), 1)
    assert scope.most_frames() == 62_500
    scope.arm_burst(5)
    frames = scope.read_burst()
    assert frames.codes.shape == (5, 2, 50)
    assert frames.trigger_offset_s.shape == (5, 2)
    assert (np.diff(frames.time_s) > 0).all()
    assert scope.most_frames() == 62_500


@pytest.mark.parametrize(
    "left",
    [
        *("CH1:INVert ON", "CH1:BANdwidth 1E9", "CH1:DESKew 4E-9", "CH1:PROBEFunc:EXTAtten 10", "CH1:POSition 2"),
        *("CH1:OFFSet 0.5", "CH1:BANdwidth:FILTer:OPTIMIZation FLATNESS", "HORizontal:POSition 50"),
        *("HORizontal:DELay:MODe ON", "HORizontal:MODe:MANual:CONFIGure RECORDLength", "HORizontal:MODe AUTO"),
        *("TRIGger:A:HOLDoff:BY RANDom", "TRIGger:A:HOLDoff:TIMe 1", "TRIGger:A:EDGE:COUPling HFRej"),
        *("TRIGger:A:MODe AUTO", "TRIGger:AUXLevel 1", "TRIGger:A:EDGE:SLOpe FALL", "ACQuire:MODe AVErage"),
        *("DISplay:GLObal:CH3:STATE ON", "HORizontal:FASTframe:STATE ON", "DATa:ENCdg RPBinary", "DATa:STARt 7"),
        "WFMOutpre:BYT_Nr 1",
    ],
)
def test_what_a_former_user_left_is_set(scope: Mso6b, second: VisaLink, left: str) -> None:
    scope.configure(SHORT, AUX, (1,), 1)
    scope.set_vertical(1, Vertical(0.1, 0.0))
    question = f"{left.split()[0]}?"
    found = second.query(f"{left};:{question}")
    scope.configure(SHORT, AUX, (1,), 1)
    scope.set_vertical(1, Vertical(0.1, 0.0))
    assert second.query(question) != found


def test_what_somebody_changes_meanwhile_is_told(bench: Bench, scope: Mso6b, second: VisaLink) -> None:
    scope.configure(SHORT, AUX, (1,), 1)
    scope.set_vertical(1, Vertical(0.1, 0.0))
    assert scope.changes() == ()
    second.query("HORizontal:POSition 10;:CH1:SCAle 0.2;*OPC?")
    assert {change.setting for change in scope.changes()} == {"HORizontal:POSition", "CH1:SCAle"}
    with pytest.raises(SettingChanged, match="its settings were changed from elsewhere"):
        bench.capture()


@pytest.mark.parametrize(
    ("timebase", "channel", "vertical"),
    [(Timebase(50e9, 50), 1, Vertical(0.1, 0.0)), (SHORT, 1, Vertical(2.0, 0.0))],
)
def test_what_it_does_not_have_is_refused(scope: Mso6b, timebase: Timebase, channel: int, vertical: Vertical) -> None:
    with pytest.raises(OutOfRange):  # noqa: PT012
        scope.configure(timebase, AUX, (1,), 1)
        scope.set_vertical(channel, vertical)


def test_whether_triggers_come(bench: Bench, scope: Mso6b) -> None:
    scope.configure(SHORT, AUX, (1,), 1)
    assert scope.triggered()
    bench.awg.stop()
    assert not scope.triggered()


def test_missing_triggers_end_in_a_clear_error(bench: Bench, scope: Mso6b, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("instruments.tektronix_mso6b.TRIGGER_WAIT_S", 0.2)
    monkeypatch.setattr("instruments.tektronix_dpo72504dx.STALLED_S", 0.05)
    bench.awg.stop()
    scope.configure(SHORT, AUX, (1,), 1)
    scope.arm()
    with pytest.raises(NoTrigger, match=r"scope at .* no trigger came within 0.2 s: check"):
        scope.wait()
    scope.arm_burst(7)
    with pytest.raises(NoTrigger, match=r"scope at .* took 0 of 7 frames, and none for 0.05 s: check"):
        scope.read_burst()
    scope.make_safe()
    with pytest.raises(InstrumentError, match="reports 2241,"):
        scope.read()


def test_lists_of_frames_are_read_however_they_are_laid_out() -> None:
    """The manual leaves quotes, blanks and the number of colons open."""
    stamps = "1: 22.11.2026.23:59::59.900000000001, 2: 23.11.2026.00:00::00.100000000000"
    for reply in (stamps, stamps.replace("::", ":"), f'"{stamps}"', stamps.replace(", ", ",")):
        assert frame_times(reply) == pytest.approx([0.900000000001, 1.1], abs=1e-12)
    for reply in ("1:1.5E-12,2:-3E-13", '"1: 1.5E-12","2: -3E-13"', "(1: 1.5E-12, 2: -3E-13)"):
        assert frame_offsets(reply) == pytest.approx([1.5e-12, -3e-13])


@pytest.mark.parametrize("reply", ["nonsense", "2: 22.11.2026.23:59::59.900000000001"])
def test_a_list_that_leaves_frames_out_is_none(reply: str) -> None:
    with pytest.raises(ValueError, match=reply):
        frame_times(reply)
    with pytest.raises(ValueError, match=reply):
        frame_offsets(reply)
