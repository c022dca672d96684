"""One record of the virtual oscilloscope: arming, triggers, averages, time."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backends.virtual import VirtualDpo72504dx
from tests.sim_backends.virtual.dpo72504dx.session import block, events, number, playback, volts
from tests.sim_backends.virtual.watched import Ask, Read, Watched


def test_single_acquisition(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    assert ask(scope, "ACQuire:STATE RUN;*OPC?") == b"1"
    assert ask(scope, "ACQuire:STATE?;NUMACq?;:BUSY?;:TRIGger:STATE?") == b"0;1;0;SAVE"
    (acquisition, times) = world.records[-1]
    assert (acquisition.channels, acquisition.samples, acquisition.start_s, times.size) == ((1, 2, 3), 500, 0.0, 1)
    assert block(ask(scope, "CURVe?")).size == 500
    ask(scope, "DATa:SOUrce CH2;:CURVe?\nDISplay:WAVEform OFF\nCH1:LABel:NAMe 'a'\nCH1:SCAle 0.02")
    assert len(world.records) == 1


def test_records_belong_to_the_settings_they_were_taken_with(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    before = volts(ask, scope)
    ask(scope, "CH1:SCAle 0.5;OFFSet 1;:HORizontal:POSition 50")
    assert np.array_equal(volts(ask, scope), before)
    assert number(ask, scope, "WFMOutpre:PT_Off?") == 0


def test_two_acquisitions_differ_by_noise_only(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "ACQuire:STATE RUN")
    first = volts(ask, scope)
    ask(scope, "ACQuire:STATE RUN")
    second = volts(ask, scope)
    assert not np.array_equal(first, second)
    assert np.corrcoef(first, second)[0, 1] > 0.9


def test_inversion_and_clipping(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "CH1:INVert ON;OFFSet 0;:ACQuire:STATE RUN")
    assert volts(ask, scope).mean() < 0
    ask(scope, "CH1:INVert OFF;SCAle 0.00625;OFFSet -0.2;:ACQuire:STATE RUN")
    assert set(block(ask(scope, "CURVe?"))) == {127.0}


def test_average(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "ACQuire:MODe AVErage;NUMAVg 100;STATE RUN")
    assert ask(scope, "ACQuire:NUMACq?;MODe:ACTUal?") == b"100;AVERAGE"
    assert [times.size for _, times in world.records] == [100]
    coarse = volts(ask, scope)
    ask(scope, "WFMOutpre:BYT_Nr 2")
    assert ask(scope, "WFMOutpre:BIT_Nr?") == b"16"
    fine = volts(ask, scope, "<i2")
    step = number(ask, scope, "WFMOutpre:YMUlt?")
    assert step == pytest.approx(0.01 / 25 / 256)
    assert np.abs(coarse - fine).max() <= 0.01 / 25 * 0.51
    assert len(set(np.rint((fine - fine[0]) / step) % 256)) > 20
    ask(scope, "ACQuire:MODe SAMple;STATE RUN;:WFMOutpre:BYT_Nr 2")
    single = block(ask(scope, "CURVe?"), "<i2")
    assert not np.any(single % 256)
    noise = np.std(volts(ask, scope, "<i2") - fine)
    ask(scope, "ACQuire:MODe AVErage;STATE RUN")
    assert np.std(volts(ask, scope, "<i2") - fine) < noise / 4


def test_running_freely_an_average_is_exponential(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    """Of all triggers at first, from NUMAVg of them on each new one weighs 1/NUMAVg; a single sequence ends there."""
    ask(scope, "ACQuire:MODe AVErage;NUMAVg 4;STOPAfter RUNSTop;STATE RUN;:WFMOutpre:BYT_Nr 2")
    lit = volts(ask, scope, "<i2").mean()
    world.emit(None)
    assert volts(ask, scope, "<i2").mean() / lit == pytest.approx((1 - 1 / 4) ** 4, abs=0.05)
    ask(scope, "ACQuire:STATE RUN")
    assert volts(ask, scope, "<i2").mean() / lit == pytest.approx(0, abs=0.05), "begun anew"


def test_waits_for_a_trigger_that_another_client_causes(
    ask: Ask, read: Read, scope: VirtualDpo72504dx, world: Watched
) -> None:
    world.play(None)
    execution = scope.run(read("ACQuire:STATE RUN;*OPC?")[0])
    next(execution)
    next(execution)
    assert ask(scope, "BUSY?;:ACQuire:STATE?;:TRIGger:A:READY?;:TRIGger:STATE?") == b"1;1;1;READY"
    assert ask(scope, "CURVe?") == b""
    world.play(playback())
    with pytest.raises(StopIteration) as end:
        next(execution)
    assert end.value.value == [b"1"]
    assert ask(scope, "BUSY?;:TRIGger:A:READY?") == b"0;0"


@pytest.mark.parametrize("settings", ["AUXLevel 1.5", "A:EDGE:SOUrce CH1;:TRIGger:A:LEVel 4"])
def test_a_level_out_of_reach_never_triggers(ask: Ask, scope: VirtualDpo72504dx, settings: str) -> None:
    ask(scope, f"TRIGger:{settings}")
    with pytest.raises(BlockingIOError):
        ask(scope, "ACQuire:STATE RUN;*OPC?")
    ask(scope, "ACQuire:STATE STOP")
    assert ask(scope, "BUSY?;*OPC?") == b"0;1"
    assert ask(scope, "CURVe?") == b""
    assert events(ask, scope) == "2241"


def test_forced_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "TRIGger FORCe")
    assert world.records == []
    world.play(None)
    ask(scope, "ACQuire:STATE RUN")
    ask(scope, "TRIGger FORCe")
    assert ask(scope, "ACQuire:STATE?;*OPC?") == b"0;1"
    assert block(ask(scope, "CURVe?")).size == 500


def test_auto_mode_does_without_a_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    world.play(None)
    before = world.clock.now
    assert ask(scope, "TRIGger:A:MODe AUTO;:ACQuire:STATE RUN;*OPC?") == b"1"
    assert world.clock.now - before == pytest.approx(0.12, rel=0.01)


def test_channel_trigger(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "ACQuire:STATE RUN")
    middle = float(np.median(volts(ask, scope)))
    ask(scope, f"TRIGger:A:EDGE:SOUrce CH1;SLOpe FALL;:TRIGger:A:LEVel {middle};:HORizontal:POSition 50")
    assert ask(scope, "TRIGger:A:EDGE:SOUrce?;SLOpe?;SLOpe:CH1?;AUX?") == b"CH1;FALL;FALL;RISE"
    assert number(ask, scope, "TRIGger:A:LEVel:CH1?") == pytest.approx(middle)
    assert ask(scope, "ACQuire:STATE RUN;*OPC?") == b"1"
    assert number(ask, scope, "WFMOutpre:PT_Off?") == 250
    around = volts(ask, scope)[245:256]
    assert around[:5].mean() > middle > around[-5:].mean()


def test_running_freely_each_transfer_is_new(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "ACQuire:STOPAfter RUNSTop;STATE RUN")
    assert ask(scope, "*OPC?;:ACQuire:STATE?;:BUSY?;:TRIGger:STATE?;:TRIGger:A:READY?") == b"1;1;1;TRIGGER;0"
    assert ask(scope, "CURVe?") != ask(scope, "CURVe?")
    ask(scope, "ACQuire:STATE STOP")
    assert ask(scope, "CURVe?") == ask(scope, "CURVe?")
    assert ask(scope, "ACQuire:NUMACq?;STATE?") == b"3;0"
    world.play(None)
    kept = ask(scope, "CURVe?")
    assert ask(scope, "ACQuire:STATE RUN;:CURVe?") == kept


def test_opc_bit_after_the_acquisition(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    world.play(None)
    ask(scope, "ACQuire:STATE RUN;*OPC")
    assert ask(scope, "*ESR?") == b"0"
    world.play(playback())
    assert ask(scope, "*ESR?;EVMsg?") == b'1;402,"Operation complete"'


def test_time_costs(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    before = world.clock.now
    ask(scope, "ACQuire:STATE RUN;*OPC?")
    assert world.clock.now - before == pytest.approx(20e-3, abs=1e-6)
    before = world.clock.now
    ask(scope, "CURVe?")
    assert world.clock.now - before == pytest.approx(5e-3)
    before = world.clock.now
    ask(scope, "ACQuire:MODe AVErage;NUMAVg 1000;STATE RUN")
    assert world.clock.now - before == pytest.approx(20e-3 + 1000 * 10e-6, rel=0.05)
    before = world.clock.now
    ask(scope, "TRIGger:A:HOLDoff:BY TIMe;TIMe 1e-3;:ACQuire:NUMAVg 10;STATE RUN")
    assert world.clock.now - before == pytest.approx(20e-3 + 9 * 1e-3, rel=0.01)


def test_a_record_too_long_for_the_simulation_is_refused_and_the_next_one_taken(
    ask: Ask, scope: VirtualDpo72504dx, world: Watched
) -> None:
    ask(scope, "HORizontal:MODE AUTO;:HORizontal:MODE:SCAle 1E-3;:ACQuire:STATE RUN")
    assert events(ask, scope) == "225"
    assert ask(scope, "ACQuire:STATE?;NUMACq?;:BUSY?") == b"0;0;0"
    ask(scope, "CURVe?")
    assert events(ask, scope) == "2241"
    ask(scope, "HORizontal:MODE:SCAle 1E-8;:ACQuire:STATE RUN")
    assert ask(scope, "ACQuire:NUMACq?") == b"1"
    assert volts(ask, scope).std() > 0
    assert events(ask, scope) == ""


@pytest.mark.parametrize("noticed", ["*ESR?", "serial poll"])
def test_a_burst_too_long_for_the_simulation_is_over(
    ask: Ask, scope: VirtualDpo72504dx, world: Watched, noticed: str
) -> None:
    ask(scope, "HORizontal:MODE:SAMPLERate 1E6;RECOrdlength 5000;:HORizontal:FASTframe:STATE ON;COUNt 3")
    ask(scope, "ACQuire:STATE RUN;*OPC")
    if noticed == "serial poll":
        scope.status_byte()
    assert events(ask, scope) == "225,402"
    assert ask(scope, "BUSY?;*OPC?") == b"0;1"


def test_a_drive_too_long_for_the_simulation_is_refused(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    world.play(replace(playback(), sample_rate=1e6))
    ask(scope, "ACQuire:STATE RUN;*ESR?")
    assert b"a drive of 0.0025 s" in ask(scope, "EVMsg?")
    world.play(playback())
    ask(scope, "ACQuire:STATE RUN")
    assert volts(ask, scope).std() > 0
