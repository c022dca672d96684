"""What a link makes of wrong replies: an error or the right data, never the answer to another question."""

import itertools
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.errors import InstrumentError, LinkError
from instruments.visa import VisaLink, tektronix_event_queue
from sim_backends.faults.bench import Befalling, FaultyBench
from sim_backends.faults.catalogue import (
    FRAMES,
    QUEUE,
    START,
    TRACE,
    TRACE_LIES,
    UPLOAD,
    WIRE,
    Arrival,
    Fault,
    Moment,
)
from sim_backends.faults.distortions import Distortion, instead
from sim_backends.servers.disturbed import Disturbed
from tests.faults.matrix import SMALL

Through = Callable[..., VisaLink]
PATIENCE_S = 10.0  # for what comes, however busy the machine is
SILENCE_S = 0.3  # for what does not come
BREAKING = ("refused", "lost before", "lost inside", "no end", "empty", "frame longer", "frame shorter", "number ahead")
LONG_WAITS = (("lost inside", "vxi11"), ("frame shorter", "vxi11"))
"""pyvisa-py waits for seconds then, whatever the timeout; the short form of the matrix has both faults on VXI-11."""


@pytest.fixture
def through(log: Any) -> Iterator[Through]:
    """A link to an instrument that a fault befalls."""
    with ExitStack() as stack:

        def connect(
            fault: Fault,
            moment: str,
            role: str = "awg",
            count: int = 1,
            transport: str = "socket",
            timeout_s: float = PATIENCE_S,
        ) -> VisaLink:
            bench = stack.enter_context(FaultyBench([Befalling(role, fault, Moment(moment, count))], SMALL))
            link = VisaLink(bench.resources[role][transport], name=role, timeout_s=timeout_s, transcript=log)
            stack.callback(link.close)
            return link

        yield connect


def _nth_error() -> Distortion:
    """Each error another one, over two lines, and longer than any."""
    number = itertools.count(1)
    return lambda _reply: Disturbed(b'-%d,"two\nlines"%s\n' % (next(number), b"!" * 9999))


@pytest.mark.parametrize("name", ["single bytes", "no harm at all"])
def test_however_a_reply_is_cut_it_is_the_same(name: str, through: Through) -> None:
    link = through(WIRE.get(name, Fault("nothing")), "*IDN?")
    assert link.query("*IDN?").startswith("TEKTRONIX,AWG70002A,")
    assert link.number("CLOCk:SRATe?") == 25e9


def test_a_reply_that_fills_a_buffer_is_read_whole(through: Through) -> None:
    assert len(through(WIRE["buffer's edge"], "*IDN?").query("*IDN?")) == 20 * 1024 - 1


def test_a_reply_that_came_twice_is_no_answer_to_the_next_question(through: Through) -> None:
    link = through(WIRE["twice"], "*IDN?")
    link.query("*IDN?")
    with pytest.raises(LinkError, match="came unasked"):
        link.query("CLOCk:SOURce?")
    assert link.query("CLOCk:SOURce?") == "INT"


def test_a_late_reply_is_no_answer_to_the_next_question(through: Through) -> None:
    link = through(WIRE["late"], "*IDN?")
    with pytest.raises(LinkError, match="did not answer in time"):
        link.query("*IDN?", timeout_s=SILENCE_S)
    assert link.query("CLOCk:SOURce?") == "INT"


@pytest.mark.parametrize("name", ["garbage", "not ASCII", "empty"])
def test_bytes_that_are_no_text_are_no_reply(name: str, through: Through) -> None:
    link = through(WIRE[name], "CLOCk:SOURce?")
    with pytest.raises(LinkError, match="is no text"):
        link.query("CLOCk:SOURce?")
    assert link.query("CLOCk:SOURce?") == "INT"


def test_a_long_reply_with_garbage_behind_is_refused_at_once(through: Through) -> None:
    link = through(WIRE["garbage behind"], "*IDN?")
    with pytest.raises(LinkError, match=r"'TEKTRONIX,AWG70002A,.*' is no text"):
        link.query("*IDN?")


def test_errors_of_the_instrument_are_lines_and_not_too_many(through: Through) -> None:
    link = through(Fault("a queue without an end", answers={"SYSTem:ERRor?": _nth_error()}), "*IDN?")
    link.query("*IDN?")
    with pytest.raises(InstrumentError) as refused, link.checked():
        pass
    assert '-1,"two lines"' in str(refused.value)
    assert str(refused.value).endswith("and 59 more")
    assert len(str(refused.value)) < 2000


def test_lines_between_quotation_marks_belong_to_one_reply(through: Through) -> None:
    link = through(WIRE["CR LF in quotes"], "SYSTem:ERRor?")
    assert link.query("SYSTem:ERRor?") == '-300,"Device-specific error;\r\nsee the screen"'
    assert link.query("CLOCk:SOURce?") == "INT"


def test_a_link_that_the_instrument_closed_is_opened_anew_with_the_next_message_but_one(through: Through) -> None:
    link = through(WIRE["lost after"], "*IDN?")
    link.query("*IDN?")
    with pytest.raises(LinkError, match="cannot be reached"):
        link.query("CLOCk:SOURce?")
    assert link.query("CLOCk:SOURce?") == "INT"


def test_the_end_of_a_connection_ends_the_wait_for_a_reply(through: Through) -> None:
    link = through(WIRE["lost inside"], "*OPC?")
    with pytest.raises(LinkError, match="the instrument closed the connection"):
        link.query("*OPC?", timeout_s=200.0)


def test_a_message_that_an_instrument_feigns_to_obey_changes_nothing(through: Through) -> None:
    link = through(Fault("feigned", arrives=Arrival.FEIGNED, reply=instead(b"1")), "CLOCk:SRATe")
    assert link.query("CLOCk:SRATe 1E9;*OPC?") == "1"
    assert link.number("CLOCk:SRATe?") == 25e9


def test_a_command_that_is_not_heard_leaves_the_rest_of_its_message(through: Through) -> None:
    link = through(Fault("deaf", deaf_to="CLOCk:SRATe"), "CLOCk:SRATe")
    assert link.query("CLOCk:SRATe 1E9;*OPC?") == "1"
    assert link.number("CLOCk:SRATe?") == 25e9


@pytest.mark.parametrize(
    ("name", "answers"),
    [
        ("scale doubled", (2.0, 0.0)),
        ("scale zero", (0.0, 0.0)),
        ("offset of a millisecond", (1.0, 1e-3)),
        ("offset not a number", (1.0, 9.91e37)),
    ],
)
def test_a_scope_that_lies_answers_every_question_alike(
    name: str, answers: tuple[float, float], through: Through
) -> None:
    link = through(TRACE_LIES[name], "ACQuire:STATE", "scope")
    honest = link.number("WFMOutpre:YMUlt?")
    link.query("HEADer OFF;:ACQuire:STOPAfter SEQuence;:ACQuire:STATE RUN;*OPC?")
    found = [float(link.query(f"WFMOutpre:{field}?")) for field in ("YMUlt", "XZEro")]
    fields = link.query("WFMOutpre?").split(";")
    assert found == pytest.approx([answers[0] * honest, answers[1]])
    assert [float(fields[place]) for place in (14, 11)] == found


def test_a_link_that_is_refused_says_so(through: Through) -> None:
    link = through(START["nobody there"], "", count=0)
    with pytest.raises(LinkError, match=r"cannot be reached.*refused"):
        link.query("*IDN?")


@pytest.mark.parametrize("name", ["block longer", "block shorter", "header #A"])
def test_a_block_is_as_long_as_its_header_says(name: str, through: Through) -> None:
    link = through(TRACE[name], "WLISt:WAVeform:DATA?", timeout_s=SILENCE_S)
    samples = np.linspace(-1, 1, 2400, dtype="<f4")
    link.write('WLISt:WAVeform:NEW "w",2400')
    link.write_block('WLISt:WAVeform:DATA "w",', samples)
    if name != "header #A":
        with pytest.raises(LinkError, match=r"goes on with|did not answer in time"):
            link.read_block('WLISt:WAVeform:DATA? "w"', np.empty(2400, "<f4"))
    link.timeout_s = PATIENCE_S
    assert np.array_equal(link.read_block('WLISt:WAVeform:DATA? "w"', np.empty(2400, "<f4")), samples)


@pytest.mark.filterwarnings("ignore:unclosed:ResourceWarning")  # pyvisa-py's, of a session that it cannot open
@pytest.mark.parametrize(
    ("fault", "transport"),
    [
        pytest.param(fault, transport, marks=pytest.mark.full if (fault, transport) in LONG_WAITS else ())
        for fault in BREAKING
        for transport in ("hislip", "vxi11")
    ],
)
def test_whatever_breaks_a_session_is_an_error_of_the_link(fault: str, transport: str, through: Through) -> None:
    link = through((WIRE | FRAMES)[fault], "*IDN?", transport=transport, timeout_s=SILENCE_S)
    with pytest.raises(LinkError, match="awg at TCPIP"):
        link.query("*IDN?")
    link.timeout_s = PATIENCE_S
    if fault != "refused":
        assert link.query("CLOCk:SOURce?") == "INT"


@pytest.mark.parametrize("transport", ["hislip", "vxi11"])
@pytest.mark.parametrize("fault", [TRACE["block shorter"], WIRE["empty"], WIRE["garbage"]])
def test_a_message_that_ends_inside_a_block_ends_the_wait_for_it(
    fault: Fault, transport: str, through: Through
) -> None:
    link = through(fault, "WLISt:WAVeform:DATA?", transport=transport)
    samples = np.linspace(-1, 1, 2400, dtype="<f4")
    link.write('WLISt:WAVeform:NEW "w",2400')
    link.write_block('WLISt:WAVeform:DATA "w",', samples)
    with pytest.raises((LinkError, InstrumentError)):
        link.read_block('WLISt:WAVeform:DATA? "w"', np.empty(2400, "<f4"))
    assert np.array_equal(link.read_block('WLISt:WAVeform:DATA? "w"', np.empty(2400, "<f4")), samples)


@pytest.mark.parametrize("transport", ["socket", "hislip", pytest.param("vxi11", marks=pytest.mark.full)])
def test_a_link_that_ends_inside_a_block_leaves_what_was_in_memory(transport: str, through: Through) -> None:
    link = through(UPLOAD["lost inside a block"], "WLISt:WAVeform:DATA", transport=transport)
    samples = np.ones(1_000_000, np.float32)
    link.write('WLISt:WAVeform:NEW "w",1000000')
    with pytest.raises(LinkError):
        _upload(link, samples)
    assert not link.read_block('WLISt:WAVeform:DATA? "w",0,2400', np.empty(2400, "<f4")).any()


def _upload(link: VisaLink, samples: NDArray[np.float32]) -> None:
    link.write_block('WLISt:WAVeform:DATA "w",', samples)
    link.query("*OPC?")


def test_a_block_that_is_lost_leaves_what_was_in_memory(through: Through) -> None:
    link = through(UPLOAD["block ignored"], "WLISt:WAVeform:DATA")
    link.write('WLISt:WAVeform:NEW "w",2400')
    link.write_block('WLISt:WAVeform:DATA "w",', np.ones(2400, np.float32))
    assert not link.errors()
    assert not link.read_block('WLISt:WAVeform:DATA? "w"', np.empty(2400, "<f4")).any()


def test_an_event_register_that_is_no_number_is_an_error_in_one_line(through: Through) -> None:
    link = through(WIRE["with header"], "*ESR?", "scope")
    with pytest.raises(InstrumentError, match="not with a number"):
        tektronix_event_queue(link)


def test_more_errors_than_the_queue_holds_are_told_with_the_overflow(through: Through) -> None:
    link = through(QUEUE["queue overflow"], "*IDN?")
    with pytest.raises(InstrumentError, match=r"-300,.*-350,"), link.checked():
        link.query("*IDN?")
    assert not link.errors()
