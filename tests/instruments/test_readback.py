"""Every setting that an instrument may round is read back: small steps are taken as they are, large ones refused."""

import re
import socket
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from instruments.alnair_tlg220 import Tlg220
from instruments.errors import InstrumentError
from instruments.laser_table import LaserTable
from instruments.readback import confirm
from instruments.tektronix_awg70002a import Awg70002a
from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.values import Drive, EdgeTrigger, Timebase, Vertical
from instruments.visa import VisaLink, scpi_error_queue, tektronix_event_queue
from labctl.bench.simulation import SIMULATED_LASER

AUX = EdgeTrigger("AUX", 0.5)


@given(st.floats(-1e9, 1e9), st.floats(-1e9, 1e9), st.floats(0, 1e9))
def test_inside_the_tolerance_what_was_read_back_goes_on(asked: float, got: float, tolerance: float) -> None:
    if abs(got - asked) <= tolerance:
        assert confirm("awg: amplitude", asked, got, tolerance) == got
    else:
        with pytest.raises(InstrumentError, match=r"^awg: amplitude: asked for .*, got .*: choose a value") as told:
            confirm("awg: amplitude", asked, got, tolerance)
        assert "\n" not in str(told.value)


@pytest.mark.parametrize(("asked", "got"), [(25e9, 25.0001e9), (1.0, float("nan")), (9, 10), (0.5, -0.5)])
def test_the_message_shows_the_difference(asked: float, got: float) -> None:
    with pytest.raises(InstrumentError) as told:
        confirm("awg: sample rate", asked, got, 0.0, unit="S/s", remedy="ask the maker")
    found = re.fullmatch(r"awg: sample rate: asked for (\S+) S/s, got (\S+) S/s: ask the maker", str(told.value))
    assert found
    assert found[1] != found[2]


class Stubborn:
    """Remembers every setting and answers with it, but to some queries with a value of its own.

    Of a block of samples it remembers the beginning, and swallows all other blocks.
    """

    def __init__(self, **own: str) -> None:
        self.own = own
        self.settings: dict[str, str] = {}
        self._samples = b""
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"TCPIP0::127.0.0.1::{self._listener.getsockname()[1]}::SOCKET"
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        self._listener.close()

    def _serve(self) -> None:
        client, _ = self._listener.accept()
        with client, client.makefile("rb") as stream:
            while line := self._line(stream):
                words = line.decode("latin-1").strip().split(maxsplit=1)
                if words and words[0] == "WLISt:WAVeform:DATA?":
                    block = self._samples[: 4 * int(words[1].split(",")[-1])]
                    client.sendall(b"#4%04d%b\n" % (len(block), block))
                elif words and "?" in words[0]:
                    questions = " ".join(words).split(";:")
                    answers = [self._answer(question.partition("?")[0]) for question in questions]
                    client.sendall(";".join(answers).encode() + b"\n")
                elif len(words) == 2:
                    self.settings[words[0]] = words[1]

    def _answer(self, header: str) -> str:
        key = header.replace(":", "_").replace("*", "")
        return self.own.get(key, self.settings.get(header, {"*OPC": "1", "SETTLED": "1"}.get(header, "0")))

    def _line(self, stream: Any) -> bytes:
        line = b""
        while byte := stream.read(1):
            line += byte
            if byte == b"\n":
                break
            if re.search(rb",#\d$", line):
                rest = int(stream.read(int(line[-1:])))
                if line.startswith(b"WLISt:WAVeform:DATA "):
                    self._samples = stream.read(min(rest, 4 * Awg70002a.READ_BACK_SAMPLES))
                    rest -= len(self._samples)
                while rest:
                    rest -= len(stream.read(min(rest, 65536)))
        return line


LIMITS = {"WLISt_WAVeform_LMINimum": "2400", "WLISt_WAVeform_LMAXimum": "5000000", "OUTPut1_PATH": "DIR"}


Opened = Callable[..., Any]


@pytest.fixture
def opened(log: Any) -> Iterator[Opened]:
    """Opens a driver (awg, scope or laser) of a stubborn instrument with values of its own."""

    def link(name: str, address: str) -> VisaLink:
        queue = tektronix_event_queue if name == "scope" else scpi_error_queue
        return VisaLink(address, name=name, timeout_s=5, transcript=log, error_queue=queue)

    drivers: dict[str, Callable[[str], Awg70002a | Dpo72504dx | Tlg220]] = {
        "awg": lambda address: Awg70002a(link("awg", address)),
        "scope": lambda address: Dpo72504dx(link("scope", address)),
        "laser": lambda address: Tlg220(address, LaserTable.read(SIMULATED_LASER), log),
    }
    with ExitStack() as stack:

        def build(name: str, **own: str) -> Any:
            instrument = stack.enter_context(closing(Stubborn(**own)))
            return stack.enter_context(closing(drivers[name](instrument.address)))

        yield build


def drive(samples: int = 2500) -> Drive:
    values = np.random.default_rng(0).uniform(-1, 1, samples).astype(np.float32)
    return Drive("d", values, 25e9, 0.5)


@pytest.mark.parametrize(
    ("query", "near", "far", "message"),
    [
        ("CLOCk_SRATe", "25.00000001E9", "24.9E9", r"sample rate: asked for 2.5e\+10 S/s, got 2.49e\+10 S/s"),
        ("SOURce1_VOLTage", "0.499", "0.45", "amplitude: asked for 0.5 Vpp, got 0.45 Vpp"),
        ("SOURce1_MARKer1_VOLTage_HIGH", "0.99", "1.4", "marker high level: asked for 1 V, got 1.4 V"),
        ("SOURce1_MARKer1_VOLTage_LOW", "0.01", "-0.4", "marker low level: asked for 0 V, got -0.4 V"),
        ("SOURce1_DAC_RESolution", "9", "10", "DAC resolution: asked for 9 bits, got 10 bits"),
    ],
)
def test_the_generator(query: str, near: str, far: str, message: str, opened: Opened) -> None:
    loaded = opened("awg", **LIMITS, **{query: near}).load(drive())
    assert loaded.sample_rate == (float(near) if query == "CLOCk_SRATe" else 25e9)
    assert loaded.amplitude_vpp == (float(near) if query == "SOURce1_VOLTage" else 0.5)
    with pytest.raises(InstrumentError, match=f"awg: {message}: choose a value"):
        opened("awg", **LIMITS, **{query: far}).load(drive())


def test_amplitudes_hold_for_the_direct_path_of_the_generator(opened: Opened) -> None:
    with pytest.raises(InstrumentError, match="awg: OUTPut1:PATH is 'DCA': amplitudes hold for the direct path only"):
        opened("awg", **LIMITS | {"OUTPut1_PATH": "DCA"}).load(drive())


@pytest.mark.parametrize(
    ("query", "near", "far", "message"),
    [
        ("HORizontal_MODE_SAMPLERate", "25.00000001E9", "20E9", r"asked for 2.5e\+10 S/s, got 2e\+10 S/s"),
        ("HORizontal_MODE_RECOrdlength", "500", "5000", "asked for 50 samples, got 5000 samples"),
        ("HORizontal_MAIn_DELay_TIMe", "1.01E-9", "0", "asked for 1e-09 s, got 0 s"),
        ("HORizontal_FASTframe_COUNt", "16", "10", "asked for 16 frames, got 10 frames"),
        ("CH1_TERmination", "50.0000", "1.0E6", r"asked for 50 Ohm, got 1e\+06 Ohm"),
        ("TRIGger_AUXLevel", "0.49", "0.3", "asked for 0.5 V, got 0.3 V"),
    ],
)
def test_the_oscilloscope(query: str, near: str, far: str, message: str, opened: Opened) -> None:
    timebase = Timebase(25e9, 50, 1e-9)
    opened("scope", **{query: near}).configure(timebase, AUX, (1,), 16)
    with pytest.raises(InstrumentError, match=f"scope: {query.replace('_', ':')}: {message}: choose"):
        opened("scope", **{query: far}).configure(timebase, AUX, (1,), 16)


def test_vertical_ranges_and_frames(opened: Opened) -> None:
    scope = opened("scope", CH2_SCAle="0.0101", CH2_OFFSet="0.0005")
    assert scope.set_vertical(2, Vertical(0.01, 0.0)) == Vertical(0.0101, 0.0005)
    with pytest.raises(InstrumentError, match=r"scope: CH1:SCAle: asked for 0.01 V/div, got 0.1 V/div"):
        opened("scope", CH1_SCAle="0.1").set_vertical(1, Vertical(0.01, 0.0))
    with pytest.raises(InstrumentError, match=r"scope: CH1:OFFSet: asked for 0.02 V, got 0 V"):
        opened("scope", CH1_OFFSet="0").set_vertical(1, Vertical(0.01, 0.02))
    with pytest.raises(InstrumentError, match="COUNt: asked for 2000 frames, got 1000 frames"):
        opened("scope", HORizontal_FASTframe_COUNt="1000").arm_burst(2000)


def test_an_oscilloscope_that_is_not_ready_is_asked_less_and_less_often(
    opened: Opened, monkeypatch: pytest.MonkeyPatch
) -> None:
    pauses: list[float] = []
    monkeypatch.setattr("instruments.tektronix_dpo72504dx.time.monotonic", lambda: sum(pauses))
    monkeypatch.setattr("instruments.tektronix_dpo72504dx.time.sleep", pauses.append)
    with pytest.raises(InstrumentError, match="scope: not ready for triggers after 10 s"):
        opened("scope", TRIGger_A_READY="0").arm_burst(3)
    assert pauses[:8] == [0.001, 0.002, 0.004, 0.008, 0.016, 0.032, 0.05, 0.05]


def test_the_laser(opened: Opened) -> None:
    def laser(**own: str) -> Tlg220:
        found: Tlg220 = opened("laser", ERROR='0,"none"', **own)
        return found

    assert laser(WAVELENGTH="1550.004").tune(1550.0) == 1550.004
    assert laser(POWER="13.1").set_power(0.02) == pytest.approx(20.417e-3, rel=1e-4)
    with pytest.raises(InstrumentError, match=r"laser: wavelength: asked for 1550 nm, got 1550.5 nm: check its tuning"):
        laser(WAVELENGTH="1550.5").tune(1550.0)
    with pytest.raises(InstrumentError, match=r"laser: power: asked for 13.01 dBm, got 10 dBm: check its power range"):
        laser(POWER="10").set_power(0.02)


def test_the_longest_waveform_needs_no_memory_beside_it(opened: Opened) -> None:
    longest = int(LIMITS["WLISt_WAVeform_LMAXimum"])
    awg, wanted = opened("awg", **LIMITS), drive(longest)
    told: list[tuple[int, int]] = []
    tracemalloc.start()
    try:
        awg.load(wanted, progress=lambda done, total: told.append((done, total)))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert told == [(million * 1_000_000, longest) for million in range(1, 6)]
    assert peak < wanted.samples.nbytes, "one chunk with its marker, not a copy of the whole"


def test_a_reply_that_is_no_number(opened: Opened) -> None:
    with pytest.raises(InstrumentError, match=r"awg: sample rate: asked for 2.5\d*E\+10, got 'FAST': choose"):
        opened("awg", **LIMITS, CLOCk_SRATe="FAST").load(drive())


@given(st.integers(1, 40), st.integers(0, 200), st.integers(1, 200), st.booleans())
def test_an_excerpt_is_what_the_whole_has_there(period: int, first: int, count: int, marked_once: bool) -> None:
    found = Drive("d", np.arange(period, dtype=np.float32), 25e9, 0.5)
    samples, marker = found.excerpt(first, count, marked_once=marked_once)
    assert np.array_equal(samples, np.resize(found.samples, 500)[first : first + count])
    whole = np.resize(found.marker, 500)
    whole[period:] &= not marked_once
    assert np.array_equal(marker, whole[first : first + count])
    assert found.repeated_length(count) % period == 0
    assert count <= found.repeated_length(count) < count + period
