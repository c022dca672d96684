"""The link itself: both transports, blocks, errors with line ends, lost connections, replies that come too late."""

import contextlib
import socket
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from instruments.errors import InstrumentError, InstrumentInUse, LinkError
from instruments.safe_state import UnsafeBench, safe_state
from instruments.visa import NoAnswer, VisaLink
from sim_backends.bench import SimulatedBench

PATIENCE_S = 10.0  # for what comes, however busy the machine is
SILENCE_S = 0.3  # for what does not come


@pytest.fixture(params=["socket", "hislip"])
def awg(request: pytest.FixtureRequest, simulation: SimulatedBench, log: Any) -> Iterator[VisaLink]:
    link = VisaLink(simulation.resources["awg"][request.param], name="awg", timeout_s=5, transcript=log)
    yield link
    link.close()


def test_text_and_blocks_on_either_transport(awg: VisaLink) -> None:
    samples = np.random.default_rng(0).uniform(-1, 1, 5000).astype("<f4")
    with awg.checked():
        awg.write('WLISt:WAVeform:NEW "w",5000')
        awg.write_block('WLISt:WAVeform:DATA "w",', samples)
    assert np.array_equal(awg.read_block('WLISt:WAVeform:DATA? "w"', np.empty_like(samples)), samples)
    assert awg.query("WLISt:SIZE?") == "1"


@pytest.fixture(params=["socket", "hislip"])
def scope(request: pytest.FixtureRequest, simulation: SimulatedBench, log: Any) -> Iterator[VisaLink]:
    """An oscilloscope whose trigger never comes."""
    link = VisaLink(simulation.resources["scope"][request.param], name="scope", timeout_s=5, transcript=log)
    link.write("TRIGger:A:MODe NORMal;:ACQuire:STOPAfter SEQuence;STATE RUN")
    yield link
    link.close()


def test_an_answer_that_never_came_is_not_taken_for_the_next(scope: VisaLink) -> None:
    with pytest.raises(NoAnswer):
        scope.query("*OPC?", timeout_s=SILENCE_S)
    assert scope.query("ACQuire:STATE STOP;STATE?") == "0"
    assert scope.query("*OPC?") == "1"


@pytest.mark.parametrize(
    ("scope", "transport"), [("socket", "hislip"), ("socket", "vxi11"), ("hislip", "vxi11")], indirect=["scope"]
)
def test_opening_clears_the_device_and_changes_no_setting(
    transport: str, simulation: SimulatedBench, scope: VisaLink, log: Any
) -> None:
    settings = "ACQuire:STATE?;STOPAfter?;:TRIGger:A:MODe?;:HORizontal:MODE?;:HEADer?;*ESE?"
    before = scope.query(f"*CLS;*OPC;{settings}")
    other = VisaLink(simulation.resources["scope"][transport], name="scope", timeout_s=5, transcript=log)
    assert other.query(settings) == before
    other.close()
    assert scope.query("ACQuire:STATE STOP;*ESR?") == "0", "what waited for the end of the acquisition is forgotten"


@pytest.mark.parametrize("transport", ["hislip", "vxi11"])
class TestTheInstrumentsOwnLock:
    def test_the_second_is_refused_at_once_and_the_first_hears_nothing_of_it(
        self, transport: str, simulation: SimulatedBench, log: Any
    ) -> None:
        address = simulation.resources["scope"][transport]
        first, second = (VisaLink(address, name="scope", timeout_s=5, transcript=log) for _ in range(2))
        assert first.query("*OPC?") == "1"
        with pytest.raises(InstrumentInUse, match=f"^scope at {address} is in use: another program") as error:
            second.query("*OPC?")
        assert "\n" not in str(error.value)
        assert first.query("*OPC?") == "1"
        first.close()
        assert second.query("*OPC?") == "1"
        second.close()

    def test_a_dead_holders_lock_falls_with_its_connection(
        self, transport: str, simulation: SimulatedBench, log: Any
    ) -> None:
        address = simulation.resources["awg"][transport]
        opening = f"link = VisaLink({address!r}, name='awg', timeout_s=5, transcript=lambda *_: None)"
        held = f"from instruments.visa import VisaLink; {opening}; print(link.query('*OPC?'), flush=True); input()"
        with subprocess.Popen(
            [sys.executable, "-c", held], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as holder:
            link = VisaLink(address, name="awg", timeout_s=5, transcript=log)
            assert holder.stdout is not None
            try:
                assert holder.stdout.readline() == "1\n"
                with pytest.raises(InstrumentInUse):
                    link.query("*OPC?")
            finally:
                holder.kill()
        assert link.query("*OPC?") == "1"
        link.close()

    def test_what_emits_can_be_switched_off_by_everybody(
        self, transport: str, simulation: SimulatedBench, log: Any
    ) -> None:
        if transport == "vxi11":
            pytest.skip("no laser of the simulated bench speaks VXI-11")
        address = simulation.resources["laser"][transport]
        links = [VisaLink(address, name="laser", timeout_s=5, transcript=log) for _ in range(2)]
        assert all(link.query("*IDN?").startswith("Alnair") for link in links)
        for link in links:
            link.close()


def test_the_instruments_own_words_are_in_the_error(awg: VisaLink) -> None:
    with pytest.raises(InstrumentError, match=r"awg at TCPIP0.* reports -113,"), awg.checked():
        awg.write("NO:SUCH:COMMAND 1")
    assert not awg.errors()


def test_a_reply_that_is_no_block(awg: VisaLink) -> None:
    with pytest.raises(LinkError, match="not with a block"):
        awg.read_block("*IDN?", np.empty(1, "<f4"))
    assert awg.query("*OPC?") == "1"


class Script:
    """A peer that answers each line as it is told, for what no well-behaved instrument does."""

    def __init__(self, *answers: bytes | None) -> None:
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"TCPIP0::127.0.0.1::{self._listener.getsockname()[1]}::SOCKET"
        self._answers = iter(answers)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        for _ in range(3):
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            with contextlib.suppress(ConnectionResetError), client, client.makefile("rb") as lines:
                for _line in lines:
                    answer = next(self._answers)
                    if answer is None:
                        break
                    client.sendall(answer)

    def close(self) -> None:
        self._listener.close()


@pytest.fixture
def peer(log: Any) -> Iterator[Callable[..., VisaLink]]:
    opened: list[Script | VisaLink] = []

    def connect(*answers: bytes | None) -> VisaLink:
        script = Script(*answers)
        link = VisaLink(script.address, name="peer", timeout_s=PATIENCE_S, transcript=log)
        opened.extend((link, script))
        return link

    yield connect
    for found in opened:
        found.close()


def test_an_error_text_with_a_line_end_inside(peer: Callable[..., VisaLink]) -> None:
    link = peer(b'-222,"Data out of range;OUTPUT1:PATH DCA\r\n"\n', b'0,"No error"\n', b"1\n")
    assert link.errors() == ['-222,"Data out of range;OUTPUT1:PATH DCA "']
    assert link.query("*OPC?") == "1"


def test_who_says_nothing_over_a_new_link_is_not_waited_for_over_another(peer: Callable[..., VisaLink]) -> None:
    asked: list[str] = []
    link = peer(b"1\n", b"", b"", b"")

    def stop() -> None:
        asked.append("stop")
        link.query("*OPC?", timeout_s=SILENCE_S)

    assert link.query("*OPC?") == "1"
    with pytest.raises(UnsafeBench):
        safe_state({"scope": stop})
    assert len(asked) == 2, "the link that was there may have broken unnoticed"
    with pytest.raises(UnsafeBench):
        safe_state({"scope": stop})
    assert len(asked) == 3


def test_a_connection_that_breaks_inside_a_block_is_opened_anew(peer: Callable[..., VisaLink]) -> None:
    link = peer(b"#41000" + bytes(10), None, b"1\n")
    link.timeout_s = SILENCE_S
    with pytest.raises(LinkError, match="peer at"):
        link.read_block("CURVe?", np.empty(1000, np.int8))
    link.timeout_s = PATIENCE_S
    with pytest.raises(LinkError):
        link.query("*OPC?")
    assert link.query("*OPC?") == "1"


def test_a_block_of_another_length(peer: Callable[..., VisaLink]) -> None:
    link = peer(b"#13abc\n", b"1\n")
    with pytest.raises(InstrumentError, match=r"CURVe\? gave 3 bytes, not 8: its settings were changed"):
        link.read_block("CURVe?", np.empty(2, "<f4"))
    assert link.query("*OPC?") == "1"


def test_a_block_that_nobody_asked_for_takes_no_memory(peer: Callable[..., VisaLink]) -> None:
    link = peer(b"#A4294967295")
    tracemalloc.start()
    with pytest.raises(InstrumentError, match=r"CURVe\? gave 4294967295 bytes, not 8"):
        link.read_block("CURVe?", np.empty(2, "<f4"))
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 1 << 20


def test_a_hexadecimal_length_digit(peer: Callable[..., VisaLink]) -> None:
    link = peer(b"#A0000000004" + bytes(4) + b"\n")
    assert not link.read_block("CURVe?", np.ones(4, np.int8)).any()


def test_a_host_that_is_not_there(log: Any) -> None:
    link = VisaLink("TCPIP0::127.0.0.1::9::SOCKET", name="awg", timeout_s=PATIENCE_S, transcript=log)
    with pytest.raises(LinkError, match="check address, cable and power"):
        link.query("*IDN?")
    link.close()


def test_an_address_that_is_none(log: Any) -> None:
    link = VisaLink("somewhere", name="awg", timeout_s=PATIENCE_S, transcript=log)
    with pytest.raises(LinkError, match="awg at somewhere cannot be reached"):
        link.query("*IDN?")


@pytest.mark.parametrize(
    ("resource", "why"),
    [
        ("nonsense", "that is no VISA address; one is written like TCPIP0::192.0.2.10::inst0::INSTR"),
        ("TCPIP::no-such-host.invalid::INSTR", "nothing on the network has that name or address"),
    ],
)
def test_an_address_that_is_none_is_told_so(resource: str, why: str) -> None:
    link = VisaLink(resource, name="scope", timeout_s=1.0, transcript=lambda *_: None)
    with pytest.raises(LinkError) as refused:
        link.query("*IDN?")
    assert str(refused.value) == f"scope at {resource} cannot be reached ({why}): check address, cable and power"
