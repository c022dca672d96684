"""QCoDeS' drivers of the AWG70002A and the DPO70000, unmodified."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

_drivers = pytest.importorskip("qcodes.instrument_drivers.tektronix", reason="QCoDeS is absent: `make interop`")

pytestmark = pytest.mark.usefixtures("fresh")

AMPLITUDE_V = 0.4
WAVE = AMPLITUDE_V / 2 * np.random.default_rng(4).uniform(-1, 1, 2500)
MARKER_1 = (np.arange(2500) < 50).astype(float)
MARKER_2 = (np.arange(2500) % 2).astype(float)


@pytest.fixture
def awg(resources: Any, transport: str) -> Iterator[Any]:
    driver = _drivers.TektronixAWG70002A("awg", resources["awg"][transport], visalib="@py", timeout=10)
    yield driver
    driver.close()


@pytest.fixture
def scope(visa: Any, resources: Any, transport: str) -> Iterator[Any]:
    visa(resources["scope"]["socket"]).query("HEADer OFF;:VERBose ON;*OPC?")  # the driver counts on both
    driver = _drivers.TektronixDPO70000("scope", resources["scope"][transport], visalib="@py", timeout=10)
    yield driver
    driver.close()


def upload(awg: Any, name: str = "mask0") -> None:
    wfmx = awg.makeWFMXFile(np.array([WAVE, MARKER_1, MARKER_2]), AMPLITUDE_V)
    awg.sendWFMXFile(wfmx, f"{name}.wfmx")
    awg.loadWFMXFile(f"{name}.wfmx")


def no_errors(instrument: Any) -> None:
    assert instrument.ask("SYSTem:ERRor:ALL?") == '0,"No error"'


def test_the_awg_identifies_itself(awg: Any) -> None:
    found = awg.get_idn()
    assert (found["vendor"], found["model"]) == ("TEKTRONIX", "AWG70002A")
    assert awg.model == "70002A"
    no_errors(awg)


def test_the_awg_is_set_up(awg: Any) -> None:
    awg.clock_source("Internal")
    awg.sample_rate(12.5e9)
    awg.wait_for_operation_to_complete()
    assert awg.sample_rate() == 12.5e9
    for channel in (awg.ch1, awg.ch2):
        channel.awg_amplitude(AMPLITUDE_V)
        channel.resolution(8)
        channel.marker1_high(1.2)
        channel.marker1_low(0.1)
        channel.hold("ZERO")
        assert channel.awg_amplitude() == pytest.approx(AMPLITUDE_V)
        assert channel.resolution() == 8
        assert channel.marker1_high() == pytest.approx(1.2)
    awg.all_output_off("OFF")
    assert awg.mode() == "AWG"
    no_errors(awg)


def test_a_waveform_goes_up_as_a_file(awg: Any, visa: Any, resources: Any) -> None:
    upload(awg)
    assert "mask0" in awg.waveformList
    plain = visa(resources["awg"]["socket"])
    samples = plain.query_binary_values('WLISt:WAVeform:DATA? "mask0"', datatype="f", container=np.array)
    assert np.allclose(samples * AMPLITUDE_V / 2, WAVE, atol=1e-7)
    markers = plain.query_binary_values('WLISt:WAVeform:MARKer:DATA? "mask0"', datatype="B", container=np.array)
    assert np.array_equal(markers & 0x40 != 0, MARKER_1 != 0), "bit 0 of the file is bit 6 on the wire"
    assert np.array_equal(markers & 0x80 != 0, MARKER_2 != 0)
    awg.clearWaveformList()
    assert awg.waveformList == [""]
    no_errors(awg)


def test_the_same_file_twice(awg: Any) -> None:
    upload(awg)
    upload(awg)
    assert "mask0" in awg.waveformList


def test_it_plays(awg: Any) -> None:
    upload(awg)
    awg.ch1.setWaveform("mask0")
    assert awg.ch1.assigned_asset() == "mask0"
    awg.ch1.state(1)
    awg.play()
    assert awg.run_state() == "Running"
    awg.stop()
    assert awg.run_state() == "Stopped"
    awg.ch1.clear_asset()
    assert awg.ch1.assigned_asset() == "N/A"
    no_errors(awg)


def test_a_sequence_goes_up_as_a_file(awg: Any) -> None:
    refused = awg.visa_handle.query('MMEMory:OPEN:SASSet:SEQuence "C:\\none.seqx";:SYSTem:ERRor:CODE?')
    if refused == "-113":
        pytest.skip("the virtual AWG reads no sequence files")
    waves = [[np.array([WAVE, MARKER_1, MARKER_2]), np.array([-WAVE, MARKER_1, MARKER_2])]]  # one channel, two steps
    seqx = awg.makeSEQXFile([0, 0], [1, 2], [0, 0], [0, 0], [2, 1], waves, [AMPLITUDE_V], "steps")
    awg.clearSequenceList()
    awg.sendSEQXFile(seqx, "steps.seqx")
    awg.loadSEQXFile("steps.seqx")
    assert awg.sequenceList == ["steps"]
    awg.ch1.setSequenceTrack("steps", 1)
    awg.ch1.state(1)
    awg.play()
    assert awg.run_state() == "Running"
    awg.force_jump(2)
    awg.stop()
    no_errors(awg)


def test_the_scope_identifies_itself(scope: Any) -> None:
    assert scope.get_idn()["model"] == "DPO72504DX"


def set_up(scope: Any) -> None:
    scope.horizontal.mode("manual")
    scope.horizontal.sample_rate(25e9)
    scope.horizontal.record_length(1000)
    scope.horizontal.position(0)
    scope.channel[0].scale(0.02)
    scope.channel[0].set_trace_length(500)


def test_the_scope_is_set_up(scope: Any) -> None:
    set_up(scope)
    assert scope.horizontal.record_length() == 1000
    assert scope.horizontal.sample_rate() == 25e9
    assert scope.channel[0].waveform.length() == 500
    assert scope.channel[0].termination() == 50
    scope.trigger.type("edge")
    scope.trigger.source("CH1")
    scope.trigger.edge_slope("rise")
    scope.trigger.level(0.01)
    assert scope.trigger.source() == "CH1"
    with pytest.raises(_drivers.TektronixDPOModeError):
        scope.horizontal.scale(1e-9)


@pytest.mark.usefixtures("lit")
@pytest.mark.parametrize(
    ("encoding", "width", "samples"),
    [("SRIbinary", 1, 500), ("RIBinary", 2, 500), ("SRPbinary", 1, 300), ("ASCIi", 1, 100)],
)
def test_a_scaled_trace(awg: Any, scope: Any, encoding: str, width: int, samples: int) -> None:
    upload(awg)
    awg.ch1.awg_amplitude(0.5)
    awg.ch1.resolution(8)
    awg.ch1.setWaveform("mask0")
    awg.all_output_off("OFF")
    awg.ch1.state(1)
    awg.play()
    set_up(scope)
    for line in ("TRIGger:A:MODe NORMal", "TRIGger:A:EDGE:SOUrce AUX", "TRIGger:AUXLevel 0.5"):
        scope.write(line)
    scope.acquisition.stop_after("SEQUENCE")
    scope.data.encoding(encoding)
    scope.waveform.bytes_per_sample(width)
    scope.channel[0].set_trace_length(samples)
    scope.acquisition.state("RUN")
    assert scope.ask("*OPC?") == "1"
    trace = scope.channel[0].waveform.trace()
    axis = scope.channel[0].waveform.trace_axis()
    assert trace.shape == axis.shape == (samples,)
    assert axis[-1] == pytest.approx(samples * 40e-12)
    assert 1e-3 < np.ptp(trace) < 1.0, "light that follows the drive"
    assert scope.ask("*ESR?") == "0"


@pytest.mark.usefixtures("lit")
def test_measurements(awg: Any, scope: Any) -> None:
    upload(awg)
    awg.ch1.resolution(8)
    awg.ch1.setWaveform("mask0")
    awg.all_output_off("OFF")
    awg.ch1.state(1)
    awg.play()
    set_up(scope)
    for line in ("TRIGger:A:MODe NORMal", "TRIGger:A:EDGE:SOUrce AUX", "TRIGger:AUXLevel 0.5", "DATa:ENCdg SRIbinary"):
        scope.write(line)
    scope.channel[0].set_trace_length(1000)
    scope.acquisition.stop_after("SEQUENCE")
    scope.acquisition.state("RUN")
    assert scope.ask("*OPC?") == "1"
    trace = scope.channel[0].waveform.trace()
    slot = scope.measurement[0]
    slot.source1("CH1")
    for name, value in (("mean", trace.mean()), ("pk2pk", np.ptp(trace)), ("rms", np.sqrt(np.mean(trace**2)))):
        assert slot.parameters[name]() == pytest.approx(value, rel=1e-4)
    scope.statistics.mode("ALL")
    scope.statistics.reset()
    assert slot.rms.mean() == slot.rms.max() == slot.rms.min() == pytest.approx(slot.rms())
    assert slot.rms.stdev() == 0
    assert scope.ask("*ESR?") == "0"
