"""The virtual oscilloscope's vertical extras."""

import numpy as np
import pytest

from sim_backends.virtual import VirtualDpo72504dx
from sim_backends.world.signals import AUX, Acquisition, TriggerCondition
from tests.sim_backends.virtual.dpo72504dx.session import (
    PERIOD,
    SHORT_RECORDS,
    block,
    events,
    fast_frame,
    lit,
    set_up,
    volts,
)
from tests.sim_backends.virtual.watched import SMALL, Ask, Watched
from tests.sim_backends.world.light import coming

STILL = SMALL.model_copy(
    update={
        "trigger_jitter_s": 0.0,
        "awg_jitter_s": 0.0,
        "detector_nep_w_per_rthz": 1e-15,
        "enob": 8.0,
        "record_step_s": 2.5e-12,
    }
)


@pytest.fixture
def session() -> tuple[str, ...]:
    return SHORT_RECORDS


def test_words_that_change_no_light(ask: Ask, scope: VirtualDpo72504dx) -> None:
    for command, word in [
        ("TRIGger:A:EDGE:COUPling", "NOISEREJ"),
        ("TRIGger:A:HOLDoff:BY", "RANDOM"),
        ("AUXout:SOUrce", "EVENT"),
        ("AUXout:EDGE", "FALLING"),
        ("ACQuire:SAMPlingmode", "IT"),
        ("ACQuire:INTERPEightbit", "ON"),
        ("ACQuire:ENHANCEDEnob", "AUTO"),
        ("DATa:SYNCSOUrces", "1"),
        ("HORizontal:ROLL", "ON"),
        ("HORizontal:FASTframe:TRACk", "ALL"),
        ("HORizontal:FASTframe:MULtipleframes:MODe", "OVERLAY"),
        ("HORizontal:FASTframe:MULtipleframes:NUMFRames:CH2", "3"),
        ("CH1:BANdwidth:ENHanced", "OFF"),
        ("CH1:BANdwidth:ENHanced:FORCe", "1"),
        ("CH1:BANdwidth:ENHanced:APPLYtoall", "1"),
    ]:
        assert ask(scope, f"{command} {word}\n{command}?").decode() == word, command
    assert events(ask, scope) == ""


def test_vertical_reply_forms(ask: Ask, scope: VirtualDpo72504dx) -> None:
    assert ask(scope, "CH1:TERmination?;BANdwidth:ENHanced:STATE?") == b"50.0000;1"
    for word, realised in [("TWEnty", 20e6), ("ONEfifty", 150e6), ("TWOfifty", 250e6), ("FIVe", 500e6), ("FULl", 25e9)]:
        assert float(ask(scope, f"CH1:BANdwidth {word}\nCH1:BANdwidth?")) == realised
    ask(scope, "CH1:VTERm:BIAS 0.5;:CH1:DESKew 90e-12")
    assert [float(ask(scope, query)) for query in ("CH1:VTERm:BIAS?", "CH1:DESKew?")] == pytest.approx([0.5, 80e-12])


@pytest.mark.parametrize("limits_hz", [(4e9, 4e9), (1e9, 10e9), (10e9, 25e9)])
def test_a_bandwidth_limit_acts_before_samples_are_taken(limits_hz: tuple[float, float], ask: Ask) -> None:
    """In single records, means and frames, of inputs that have the same bandwidth and that have not."""
    world = lit(STILL)
    scope = set_up(ask, world)
    ask(scope, "CH2:SCAle 0.04;OFFSet 0.1")
    trigger = TriggerCondition(AUX, 0.5, rising=True)
    period = Acquisition((1, 2), 16 * 25e9, 16 * PERIOD, 0.0)
    fine = world.record(period, coming(world, trigger, count=50)).volts.mean(axis=0, dtype=np.float64)
    frequencies = np.fft.rfftfreq(fine.shape[1], 1 / period.sample_rate)
    for channel, limit_hz in enumerate(limits_hz, start=1):
        ask(scope, f"CH{channel}:BANdwidth {limit_hz}")
        low_pass = np.exp(-np.log(2) / 2 * frequencies**2 * (limit_hz**-2 - 25e9**-2))
        fine[channel - 1] = np.fft.irfft(np.fft.rfft(fine[channel - 1]) * low_pass)
    for mode, largest in (
        ("ACQuire:MODe SAMple", 0.1),
        ("ACQuire:MODe AVErage;NUMAVg 64;:WFMOutpre:BYT_Nr 2", 0.03),
        ("ACQuire:MODe SAMple;:WFMOutpre:BYT_Nr 1;:HORizontal:FASTframe:STATE ON;LENgth 500;COUNt 2", 0.1),
    ):
        ask(scope, f"{mode};:ACQuire:STATE RUN")
        for channel, light in enumerate(fine[:, ::16][:, :500], start=1):
            ask(scope, f"DATa:SOUrce CH{channel}")
            seen = volts(ask, scope, "<i2" if "AVErage" in mode else "i1").reshape(-1, 500)
            assert np.sqrt(np.mean((seen - light) ** 2)) < largest * light.std(), (mode, channel)


def test_a_grounded_input_shows_noise_about_zero(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "CH1:COUPling GND;OFFSet 0;:ACQuire:STATE RUN;:HORizontal:MODE:RECOrdlength 1000")
    codes = block(ask(scope, "CURVe?"))
    assert abs(codes.mean()) < 1
    assert 0.5 < codes.std() < 3


def test_external_attenuation_scales_the_volts(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "CH1:OFFSet 0;SCAle 0.02;:ACQuire:STATE RUN")
    plain = block(ask(scope, "CURVe?"))
    multiplier = float(ask(scope, "WFMOutpre:YMUlt?"))
    ask(scope, "CH1:PROBEFunc:EXTDBatten 20;:ACQuire:STATE RUN")
    assert float(ask(scope, "CH1:PROBEFunc:EXTAtten?")) == pytest.approx(10)
    assert float(ask(scope, "CH1:PROBEFunc:EXTDBatten?")) == pytest.approx(20)
    assert float(ask(scope, "CH1:SCAle?")) == pytest.approx(0.2)
    assert float(ask(scope, "WFMOutpre:YMUlt?")) == pytest.approx(10 * multiplier)
    assert np.abs(block(ask(scope, "CURVe?")) - plain).mean() < 5


def test_deskew_samples_later(ask: Ask, scope: VirtualDpo72504dx, world: Watched) -> None:
    ask(scope, "HORizontal:MODE:RECOrdlength 500;:ACQuire:STATE RUN")
    plain = block(ask(scope, "CURVe?"))
    ask(scope, "CH1:DESKew 4e-9;:ACQuire:STATE RUN")
    later = block(ask(scope, "CURVe?"))
    assert [acquisition.channels for acquisition, _ in world.records] == [(1, 2), (1, 2)], "one record a trigger"
    assert np.corrcoef(plain[100:], later[:-100])[0, 1] > 0.9


def test_deskewed_channels_share_a_trigger(ask: Ask, monkeypatch: pytest.MonkeyPatch) -> None:
    """However many triggers are digitised at once: its noise, and how far from a sample it came."""
    found = []
    for at_once in (1, 2**22):
        monkeypatch.setattr("sim_backends.virtual.oscilloscope.acquisition.SAMPLES_AT_ONCE", at_once)
        world = lit(SMALL.model_copy(update={"shared_reference": False}))
        scope = set_up(ask, world)
        fast_frame(ask, scope, 3)
        ask(scope, "CH1:DESKew 4e-9;:ACQuire:STATE RUN;:DATa:SOUrce CH1,CH2")
        offsets = [ask(scope, f"HORizontal:FASTframe:XZEro:ALL:CH{channel}? 1,3") for channel in (1, 2)]
        assert offsets[0] == offsets[1]
        assert len(set(offsets[0].split(b","))) == 3
        found.append((offsets, ask(scope, "CURVe?")))
    assert found[0] == found[1]
