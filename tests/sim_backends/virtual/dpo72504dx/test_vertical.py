"""The virtual oscilloscope's vertical extras."""

import numpy as np
import pytest

from sim_backends.virtual import VirtualDpo72504dx
from tests.sim_backends.virtual.dpo72504dx.session import SHORT_RECORDS, block, events, fast_frame, lit, set_up
from tests.sim_backends.virtual.watched import SMALL, Ask, Watched


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


def test_a_lower_bandwidth_smooths(ask: Ask, scope: VirtualDpo72504dx) -> None:
    ask(scope, "HORizontal:MODE:RECOrdlength 1000;:ACQuire:STATE RUN")
    full = block(ask(scope, "CURVe?"))
    ask(scope, "CH1:BANdwidth 1e9;:ACQuire:STATE RUN")
    limited = block(ask(scope, "CURVe?"))
    assert limited.std() < 0.7 * full.std()
    assert limited.mean() == pytest.approx(full.mean(), abs=2)


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
