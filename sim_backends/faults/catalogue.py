"""The faults by name: what happens on the wire, in the instrument or in the world. Rows are data."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from sim_backends.faults import distortions, lies
from sim_backends.faults.distortions import Distortion, instead, intact, lost_after, lost_before, silent
from sim_backends.scpi.status import QUEUE_LENGTH, ScpiError
from sim_backends.virtual.awg70002a.instrument import VirtualAwg70002a
from sim_backends.virtual.dpo72504dx.instrument import VirtualDpo72504dx
from sim_backends.virtual.instrument import VirtualInstrument

DEVICE_ERROR, ILLEGAL_PARAMETER = -300, -224
MEMORY_FULL, DEVICE_REMOVED, NOT_READY = b"1007", b"1012", b"1002"


class Arrival(Enum):
    """What becomes of the message that a fault strikes."""

    CUT = auto()
    """It never reaches the instrument, since the link ends inside its block."""

    FEIGNED = auto()
    """It never reaches the instrument, which answers as if it had."""
    HEARD = auto()
    """It is executed."""
    IGNORED = auto()
    """It never reaches the instrument, and nobody notices."""
    LOST = auto()
    """It never reaches the instrument, since the link ends."""


@dataclass(frozen=True)
class Moment:
    """The message at which a fault strikes: the `count`th with this header, and `times` - 1 more of them.

    Headers are long or short (`CURVe?`, `CURV?`); an empty one is any message. `count` 0: before the first connection.
    """

    header: str = ""
    count: int = 1
    times: int = 1


@dataclass(frozen=True)
class Fault:
    """What goes wrong.

    told: for people. arrives: what becomes of the message it strikes. reply: what becomes of its reply. answers: what
    becomes from then on of the replies to some queries, by their headers. happens: in the instrument or the world, when
    the message comes. lasting: the reply to every later message as well, and what happens, before each reply. refuses:
    there are no new connections. deaf_to: the commands of this header that it does not hear in the message it strikes.
    """

    told: str
    arrives: Arrival = Arrival.HEARD
    reply: Distortion = intact
    answers: Mapping[str, Distortion] = field(default_factory=dict)
    happens: Callable[[VirtualInstrument], None] | None = None
    lasting: bool = False
    refuses: bool = False
    deaf_to: str = ""


def _queue(*codes: int) -> Callable[[VirtualInstrument], None]:
    def report(instrument: VirtualInstrument) -> None:
        for code in codes:
            instrument.status.report(ScpiError(code, "injected"))

    return report


def _clear(instrument: VirtualInstrument) -> None:
    instrument.clear()


def _darken(instrument: VirtualInstrument) -> None:
    instrument.world.emit(None)


def _unplug_marker(instrument: VirtualInstrument) -> None:
    instrument.world.play(None)


WIRE: dict[str, Fault] = {
    "refused": Fault("the link ends, new connections are refused", reply=lost_before, lasting=True, refuses=True),
    "lost before": Fault("the link ends before the reply", reply=lost_before),
    "lost inside": Fault("the link ends inside the reply", reply=distortions.lost_inside),
    "lost after": Fault("the link ends behind the reply", reply=lost_after),
    "lost each time": Fault("the link ends before this reply and every later one", reply=lost_before, lasting=True),
    "unheard": Fault("the link ends before the instrument has heard the message", arrives=Arrival.LOST),
    "no end": Fault("the reply lacks its line feed", reply=distortions.without_end),
    "late": Fault("the reply comes when the next one is due", reply=distortions.late),
    "always late": Fault(
        "every reply from then on comes when the next one is due", reply=distortions.late, lasting=True
    ),
    "no reply": Fault("the reply does not come", reply=silent),
    "dead": Fault("no reply comes any more", reply=silent, lasting=True),
    "twice": Fault("the reply comes twice", reply=distortions.twice),
    "empty": Fault("only the reply's line feed comes", reply=distortions.empty),
    "garbage": Fault("bytes that no instrument says", reply=distortions.garbage),
    "only garbage": Fault(
        "every reply from then on is bytes that no instrument says", reply=distortions.garbage, lasting=True
    ),
    "garbage behind": Fault("bytes that no instrument says behind the reply", reply=distortions.garbage_behind),
    "not ASCII": Fault("the upper bit of every byte is set", reply=distortions.not_ascii),
    "CR LF in quotes": Fault("a quoted text with CR LF inside", reply=distortions.quoted_lines),
    "with header": Fault("the reply comes with a header", reply=distortions.with_header),
    "single bytes": Fault("every byte in a packet of its own", reply=distortions.single_bytes, lasting=True),
    "buffer's edge": Fault("the reply ends where a buffer ends", reply=distortions.to_the_edge),
    "cleared": Fault("somebody clears the device, the reply is dropped", reply=silent, happens=_clear),
    "power blink": Fault(
        "the link ends, the settings are those of power-on",
        arrives=Arrival.LOST,
        happens=lambda instrument: instrument.reset(),
    ),
}
"""What may befall every instrument in every phase."""

QUEUE: dict[str, Fault] = {
    "error queued": Fault("an error is in the queue", happens=_queue(DEVICE_ERROR)),
    "queue overflow": Fault("more errors than the queue holds", happens=_queue(*[DEVICE_ERROR] * (QUEUE_LENGTH + 1))),
}
"""What may befall every instrument that has an error queue, in every phase; the DMD answers with return codes."""

START: dict[str, Fault] = {"nobody there": Fault("connections are refused from the beginning", refuses=True)}
"""What may befall every instrument before anything is said."""

TRACE: dict[str, Fault] = {
    "block longer": Fault("more bytes than the block's header says", reply=distortions.longer_block),
    "block shorter": Fault("fewer bytes than the block's header says", reply=distortions.shorter_block),
    "header #A": Fault("the block's length has ten digits, `#A`", reply=distortions.ten_digits),
    "clipped": Fault("samples at the end of the range", reply=distortions.clipped),
}
"""What may befall the block in which the oscilloscope sends a trace."""

UPLOAD: dict[str, Fault] = {
    "lost inside a block": Fault("the link ends inside the block", arrives=Arrival.CUT),
    "lost before a block": Fault("the link ends behind the block, nobody has heard it", arrives=Arrival.LOST),
    "lost after a block": Fault("the link ends when the block is there", reply=lost_after),
    "block ignored": Fault("the block never gets there, what was in memory stays", arrives=Arrival.IGNORED),
    "block refused": Fault(
        "the instrument refuses the block, what was in memory stays",
        arrives=Arrival.IGNORED,
        happens=_queue(ILLEGAL_PARAMETER),
    ),
}
"""What may befall a block that an instrument is sent."""

LASER: dict[str, Fault] = {
    "does not settle": Fault("`SETTLED?` stays 0", answers={"SETTLED?": instead(b"0")}),
    "drops out": Fault("the light goes out", answers={"OUTPUT?": instead(b"0")}, happens=_darken, lasting=True),
    "interlock": Fault(
        "the interlock opens: dark, and the queue says so",
        answers={"OUTPUT?": instead(b"0"), "ERROR?": instead(b'-310,"Interlock open"')},
        happens=_darken,
        lasting=True,
    ),
}

AWG: dict[str, Fault] = {
    "rate rounded": Fault("the clock settles elsewhere", answers={"CLOCk:SRATe?": instead(b"2.4999000000E+10")}),
    "does not run": Fault("the run state stays stopped", answers={"AWGControl:RSTate?": instead(b"0")}),
}

SCOPE: dict[str, Fault] = {
    "rate rounded": Fault(
        "the clock settles elsewhere", answers={"HORizontal:MODE:SAMPLERate?": instead(b"2.4999000000E+10")}
    ),
    "no trigger": Fault("the marker's cable is off", happens=_unplug_marker, lasting=True),
    "never armed": Fault(
        "the start of an acquisition is not heard: the trace before comes again", arrives=Arrival.IGNORED
    ),
}

BURST: dict[str, Fault] = {
    "burst, frames missing": Fault("the count stays one short", answers={"ACQuire:NUMFRAMESACQuired?": instead(b"5")}),
    "burst, stamp missing": Fault(
        "one time stamp is missing",
        answers={"HORizontal:FASTframe:TIMEStamp:ALL:CH1?": distortions.without_last_stamp},
    ),
    "burst, frames swapped": Fault(
        "two frames have changed places",
        answers={"HORizontal:FASTframe:TIMEStamp:ALL:CH1?": distortions.stamps_swapped},
    ),
    "burst, no trigger": Fault("the marker's cable is off", happens=_unplug_marker, lasting=True),
    "burst, block shorter": Fault(
        "fewer bytes than the block's header says", answers={"CURVe?": distortions.shorter_block}
    ),
}
"""What may befall the oscilloscope in a burst."""

DMD: dict[str, Fault] = {
    "memory full": Fault("1007, the memory is full", reply=instead(MEMORY_FULL)),
    "busy": Fault("1002, the device is not idle", reply=instead(NOT_READY)),
    "USB gone": Fault("1012, the device was removed, from then on", reply=instead(DEVICE_REMOVED), lasting=True),
    "USB blinks": Fault("1012 once", reply=instead(DEVICE_REMOVED)),
}

IDENTITY: dict[str, Fault] = {
    "another maker": Fault("`*IDN?` names another maker", answers={"*IDN?": instead(b"ACME,4711,SN1,1.0")}),
    "another instrument": Fault(
        "`*IDN?` names a multimeter", answers={"*IDN?": instead(b"KEITHLEY INSTRUMENTS INC.,MODEL 2000,1,A1")}
    ),
    "the generator": Fault(
        "`*IDN?` names the bench's generator", answers={"*IDN?": instead(VirtualAwg70002a.IDENTITY.encode())}
    ),
    "the oscilloscope": Fault(
        "`*IDN?` names the bench's oscilloscope", answers={"*IDN?": instead(VirtualDpo72504dx.IDENTITY.encode())}
    ),
}
"""What may befall the first question to every instrument that is asked who it is."""

TRACE_LIES: dict[str, Fault] = {
    "one channel frozen": Fault("channel 1 gives one trace for ever", happens=lies.trace_of(1, lies.frozen)),
    "one channel zero": Fault("every code of channel 1 is 0", happens=lies.trace_of(1, lambda: lies.flat(0))),
    "one channel constant": Fault("every code of channel 2 is 40", happens=lies.trace_of(2, lambda: lies.flat(40))),
    "all frozen": Fault("every channel gives one trace for ever", happens=lies.trace_of(None, lies.frozen)),
    "one behind": Fault("every channel gives the acquisition before", happens=lies.trace_of(None, lies.lagging)),
    "one channel behind": Fault("channel 2 gives the acquisition before", happens=lies.trace_of(2, lies.lagging)),
    "scale zero": Fault("YMUlt is 0", happens=lies.trace_of(None, lambda: lies.scaled(0.0))),
    "scale doubled": Fault("YMUlt is twice what it is", happens=lies.trace_of(None, lambda: lies.scaled(2.0))),
    "scale not a number": Fault("YMUlt is 9.91E37", happens=lies.trace_of(1, lambda: lies.scaled(9.91e37))),
    "offset not a number": Fault("XZEro is 9.91E37", happens=lies.trace_of(None, lambda: lies.late(9.91e37))),
    "offset of a millisecond": Fault("XZEro is 1E-3", happens=lies.trace_of(None, lambda: lies.late(1e-3))),
    "preamble of the other": Fault(
        "the preambles of channels 1 and 2 have changed places", happens=lies.preamble_of(lambda number: 3 - number)
    ),
    "odd number": Fault(
        "YMUlt and XZEro, asked for alone, are `1_0`",
        answers={"WFMOutpre:XZEro?": distortions.underscored, "WFMOutpre:YMUlt?": distortions.underscored},
    ),
}
"""What an oscilloscope may give, from one acquisition on, without a word."""

SOURCE_LIES: dict[str, Fault] = {
    "source unheard": Fault("`DATa:SOUrce` is not heard: the channel before comes again", deaf_to="DATa:SOUrce"),
}
"""What an oscilloscope may not hear of a question for points."""

PICTURE_LIES: dict[str, Fault] = {
    "picture not shown": Fault("a picture is taken and not shown", arrives=Arrival.FEIGNED, reply=instead(b"0")),
    "picture before": Fault("each picture is shown when the next one should be", happens=lies.shows_the_picture_before),
    "mirrors stuck": Fault("one picture stays on the mirrors", happens=lies.mirrors_stuck),
}
"""What a DMD may do with a picture without a word."""

FRAMES: dict[str, Fault] = {
    "number of before": Fault(
        "HiSLIP, VXI-11: the answer has the number of an earlier message", reply=distortions.wrong_number
    ),
    "number ahead": Fault(
        "HiSLIP, VXI-11: the answer has the number of a message to come", reply=distortions.number_ahead
    ),
    "frame longer": Fault(
        "HiSLIP, VXI-11: fewer bytes than the frame's length says", reply=distortions.announced_longer
    ),
    "frame shorter": Fault(
        "HiSLIP, VXI-11: more bytes than the frame's length says", reply=distortions.announced_shorter
    ),
    "in fragments": Fault("HiSLIP, VXI-11: each reply in three frames", reply=distortions.in_fragments, lasting=True),
}
"""What may befall the frames of replies; the numbers of messages are HiSLIP's message ids and VXI-11's xids."""

HISLIP: dict[str, Fault] = {
    "fatal error": Fault(
        "HiSLIP: FatalError in place of the reply, the session ends", reply=distortions.transport_error(0)
    ),
}
"""What may befall a HiSLIP session."""

VXI11: dict[str, Fault] = {
    "error 4": Fault("VXI-11: device_read fails, invalid link", reply=distortions.transport_error(4)),
    "error 15": Fault("VXI-11: device_read fails, timeout", reply=distortions.transport_error(15)),
    "error 17": Fault("VXI-11: device_read fails, I/O error", reply=distortions.transport_error(17)),
}
"""What may befall a VXI-11 link."""

_EVERY: tuple[tuple[Mapping[str, Fault], Moment], ...] = (
    (START, Moment("", 0)),
    (WIRE | FRAMES | HISLIP, Moment()),
    (IDENTITY, Moment("*IDN?")),
)
_TEKTRONIX = (*_EVERY, (QUEUE | VXI11, Moment()))
BEFALL: dict[str, tuple[tuple[Mapping[str, Fault], Moment], ...]] = {
    "awg": (*_TEKTRONIX, (UPLOAD, Moment("WLISt:WAVeform:DATA")), (AWG, Moment("AWGControl:RUN"))),
    "scope": (
        *_TEKTRONIX,
        (TRACE, Moment("CURVe?")),
        (SCOPE, Moment("ACQuire:STATE")),
        (BURST, Moment("HORizontal:FASTframe:COUNt")),
        (TRACE_LIES, Moment("ACQuire:STATE")),
        (SOURCE_LIES, Moment("DATa:SOUrce")),
    ),
    "laser": (*_EVERY, (QUEUE, Moment()), (LASER, Moment())),
    "dmd": (*_EVERY, (DMD, Moment()), (UPLOAD | PICTURE_LIES, Moment("ALP:SEQPUT"))),
    **dict.fromkeys(("patch_panel", "power_meter", "amplifier", "attenuator"), (*_EVERY, (QUEUE, Moment()))),
}
"""What may befall which instrument, and when it strikes if nobody says otherwise."""
