"""Questions leave the bench as it is: a client may compare settings between two records, and no byte will differ."""

import pytest

from sim_backends.bench import SimulatedBench
from sim_backends.scpi.commands import Setting
from sim_backends.virtual import VirtualInstrument
from tests.sim_backends.virtual.watched import SMALL, Ask

PLAYED = 'WLISt:WAVeform:NEW "m",2500;:SOURce1:CASSet:WAVeform "m";:AWGControl:RUN;*OPC?;:OUTPut1 1'
OF_THE_LASER = ("WAVELENGTH?", "POWER?", "OUTPUT?", "ERROR?")
OF_THE_DMD = ("ALP:DEVINQUIRE 2003", "ALP:PROJINQUIRE 2400", "ALP:SEQINQUIRE 1,2201")


@pytest.fixture
def lit(ask: Ask) -> SimulatedBench:
    """A bench that is lit, plays, shows a picture and has acquired."""
    bench = SimulatedBench(SMALL)
    awg, scope, laser, dmd, switch = bench._instruments.values()
    for instrument, text in (
        (awg, PLAYED),
        (laser, "OUTPUT ON;*OPC?"),
        (switch, "ROUTe:CLOSe (@1!2)"),
        (dmd, "ALP:DEVALLOC\nALP:SEQALLOC 1,1\nALP:PROJSTARTCONT 1"),
        (scope, "ACQuire:STOPAfter SEQuence;STATE RUN;*OPC?;:TRIGger:A:MODe NORMal"),
    ):
        assert isinstance(instrument, VirtualInstrument)
        ask(instrument, text)
    return bench


def questions(role: str, instrument: VirtualInstrument) -> list[str]:
    """All that ask for a setting, and what else a client may ask of it between two records."""
    settings = [command for command in instrument.COMMANDS if isinstance(command, Setting)]
    headers = [setting.header.replace("[", "").replace("]", "").replace("#", "1") + "?" for setting in settings]
    other = {"laser": OF_THE_LASER, "dmd": OF_THE_DMD, "patch_panel": ("ROUTe:CLOSe? (@1!2)",)}
    waveform = [f'WLISt:WAVeform:{what}? "m"' for what in ("TSTamp", "LENGth", "DATA", "MARKer:DATA")]
    own = {"awg": (*waveform, "SOURce1:CASSet?", "SOURce1:WAVeform?", "AWGControl:RSTate?")}
    return [*headers, *other.get(role, ()), *own.get(role, ()), "*IDN?", "*ESR?", "*STB?"]


@pytest.mark.parametrize("role", ["awg", "scope", "laser", "dmd", "patch_panel"])
@pytest.mark.parametrize("armed", [False, True], ids=["idle", "waiting for a trigger"])
def test_a_question_takes_no_virtual_time_and_no_noise(role: str, armed: bool, lit: SimulatedBench, ask: Ask) -> None:
    instrument, scope = lit._instruments[role], lit._instruments["scope"]
    assert isinstance(instrument, VirtualInstrument)
    assert isinstance(scope, VirtualInstrument)
    if armed:
        ask(scope, "TRIGger:A:EDGE:SOUrce AUXiliary;:TRIGger:AUXLevel 4;:ACQuire:STATE RUN")
    world = lit.world
    before = world.clock.now, dict(world._recorded)
    assert before[1], "nothing was acquired"
    for question in questions(role, instrument):
        ask(instrument, question)
        assert (world.clock.now, dict(world._recorded)) == before, question
