"""Plain PyVISA, as anyone would write it on an afternoon."""

from typing import Any

import numpy as np
import pytest

pytest.importorskip("pyvisa_py")

pytestmark = pytest.mark.usefixtures("fresh")

SAMPLES = np.random.default_rng(3).uniform(-1, 1, 2500).astype(np.float32)  # 4 of 10 000 bytes in a row may well be LF


@pytest.fixture
def awg(visa: Any, resources: Any, transport: str) -> Any:
    return visa(resources["awg"][transport])


@pytest.fixture
def scope(visa: Any, resources: Any, transport: str) -> Any:
    return visa(resources["scope"][transport])


@pytest.mark.parametrize("name", ["awg", "scope", "laser", "dmd", "patch_panel"])
def test_identify(visa: Any, resources: Any, transport: str, name: str) -> None:
    if transport not in resources[name]:
        pytest.skip(f"{name} serves no {transport}")
    assert len(visa(resources[name][transport]).query("*IDN?").split(",")) == 4


def test_upload_and_read_back(awg: Any) -> None:
    awg.write('WLISt:WAVeform:NEW "mask0",2500')
    assert awg.query("*OPC?") == "1"
    awg.write_binary_values('WLISt:WAVeform:DATA "mask0",0,2500,', SAMPLES, datatype="f")
    marker = np.full(2500, 0x40, np.uint8)
    awg.write_binary_values('WLISt:WAVeform:MARKer:DATA "mask0",0,2500,', marker, datatype="B")
    assert awg.query("SYSTem:ERRor:COUNt?") == "0"
    back = awg.query_binary_values('WLISt:WAVeform:DATA? "mask0"', datatype="f", container=np.array)
    assert np.array_equal(back.astype(np.float32), SAMPLES)
    markers = awg.query_binary_values('WLISt:WAVeform:MARKer:DATA? "mask0",0,100', datatype="B", container=np.array)
    assert np.array_equal(markers, marker[:100])


def test_a_large_upload_in_chunks(awg: Any) -> None:
    samples = np.linspace(-1, 1, 1_000_000, dtype=np.float32)
    awg.write('WLISt:WAVeform:NEW "ramp",1000000')
    for first in range(0, samples.size, 250_000):
        head = f'WLISt:WAVeform:DATA "ramp",{first},250000,'
        awg.write_binary_values(head, samples[first : first + 250_000], datatype="f")
        assert awg.query("SYSTem:ERRor:COUNt?") == "0"
    back = awg.query_binary_values('WLISt:WAVeform:DATA? "ramp",999900,100', datatype="f", container=np.array)
    assert np.array_equal(back.astype(np.float32), samples[-100:])


def test_errors_are_queued_and_the_link_stays_in_step(awg: Any) -> None:
    for wrong in ("CLOCk:SRATe 1", "NO:SUCH:HEADER 5", 'WLISt:WAVeform:DATA "none",#15hello', "CLOCk:SRATe"):
        awg.write(wrong)
    assert awg.query("SYSTem:ERRor:COUNt?") == "4"
    codes = [int(awg.query("SYSTem:ERRor?").split(",")[0]) for _ in range(5)]
    assert codes[0] == -222
    assert codes[1] == -113
    assert codes[3:] == [-109, 0]
    assert awg.query("*ESR?") == str(16 | 32)
    assert awg.query("*ESR?") == "0"


@pytest.mark.usefixtures("lit")
@pytest.mark.parametrize(("encoding", "datatype", "big"), [("SRIbinary", "b", False), ("RIBinary", "b", True)])
def test_a_trace_in_volts(awg: Any, scope: Any, encoding: str, datatype: str, big: bool) -> None:
    play(awg)
    acquire(scope)
    scope.write(f"DATa:ENCdg {encoding};:DATa:SOUrce CH1;STARt 1;STOP 500")
    codes = scope.query_binary_values("CURVe?", datatype=datatype, is_big_endian=big, container=np.array)
    assert codes.size == int(scope.query("WFMOutpre:NR_Pt?")) == 500
    multiplier, offset, zero = (float(scope.query(f"WFMOutpre:{field}?")) for field in ("YMUlt", "YOFf", "YZEro"))
    volts = (codes - offset) * multiplier + zero
    assert 1e-3 < np.ptp(volts) < 1.0
    assert volts.std() > 2 * multiplier, "light that follows the drive, not noise"
    assert scope.query("*ESR?") == "0"


def test_a_curve_of_a_channel_that_is_off(scope: Any) -> None:
    scope.timeout = 500
    scope.write("SELect:CH3 OFF;:DATa:SOUrce CH3")
    pyvisa = pytest.importorskip("pyvisa")
    with pytest.raises(pyvisa.VisaIOError):
        scope.query("CURVe?")
    scope.timeout = 10_000
    assert int(scope.query("*ESR?")) & 16
    assert scope.query("ALLEv?").startswith("2244,")
    assert scope.query("*OPC?") == "1"


def test_headers_on_and_off(scope: Any) -> None:
    scope.write("HEADer ON;:VERBose ON")
    assert scope.query("CH1:SCAle?").startswith(":CH1:SCALE ")
    scope.write("HEADer OFF")
    assert float(scope.query("CH1:SCAle?")) > 0


def test_two_transports_reach_one_instrument(visa: Any, resources: Any, awg: Any, transport: str) -> None:
    awg.write("CLOCk:SRATe 1.25E10")
    assert awg.query("*OPC?") == "1"
    for name, address in resources["awg"].items():
        assert float(visa(address).query("CLOCk:SRATe?")) == 12.5e9, f"{name} beside {transport}"


def play(awg: Any) -> None:
    marker = np.zeros(2500, np.uint8)
    marker[:50] = 0x40
    for line in ("SOURce1:DAC:RESolution 9", "CLOCk:SRATe 2.5E10", 'WLISt:WAVeform:NEW "light",2500'):
        awg.write(line)
    assert awg.query("*OPC?") == "1"
    awg.write_binary_values('WLISt:WAVeform:DATA "light",0,2500,', SAMPLES, datatype="f")
    awg.write_binary_values('WLISt:WAVeform:MARKer:DATA "light",0,2500,', marker, datatype="B")
    for line in ('SOURce1:CASSet:WAVeform "light"', "AWGControl:RUN", "OUTPut:OFF 0", "OUTPut1 1"):
        awg.write(line)
    assert awg.query("*OPC?") == "1"
    assert awg.query("AWGControl:RSTate?") == "2"
    assert awg.query("SYSTem:ERRor:COUNt?") == "0"


def acquire(scope: Any) -> None:
    for line in (
        *("HEADer OFF", "VERBose ON", "HORizontal:MODE MANual", "HORizontal:MODE:SAMPLERate 25E9"),
        *("HORizontal:MODE:RECOrdlength 500", "HORizontal:POSition 0", "CH1:SCAle 0.02", "SELect:CH1 ON"),
        *("TRIGger:A:MODe NORMal", "TRIGger:A:EDGE:SOUrce AUX", "TRIGger:AUXLevel 0.5", "ACQuire:STOPAfter SEQuence"),
        "ACQuire:STATE RUN",
    ):
        scope.write(line)
    assert scope.query("*OPC?") == "1"
