"""What a DPO72504DX is set to, and what it is asked about how it is set.

Commands: DPO/DSA/MSO70000 series programmer manual, as the descriptions of the package tm_devices have it.
"""

from collections.abc import Iterator, Mapping

from instruments.errors import InstrumentError
from instruments.kept_settings import Setting
from instruments.values import EdgeTrigger, Timebase, Vertical
from instruments.visa import VisaLink, number_in

INPUTS = (1, 2, 3, 4)
RATE_TOLERANCE = 1e-6
LEVEL_TOLERANCE_V = 0.02
SCALE_TOLERANCE = 0.02
OFFSET_TOLERANCE_DIV = 0.1
TERMINATION_OHM = 50
MOST_SURPLUS = 1000
"""Points that a record may have more than were asked for: single ones begin at 500 (Blackchirp allows as many)."""

PLAIN = (Setting("HEADer", "OFF"), Setting("VERBose", "ON"), Setting("DESE", "255"))
"""How it replies: numbers without headers, words in full, and every error, whatever a former user has made of it.

`FACtory` switches headers on; what DESE masks is no event, neither in `*ESR?` nor in `ALLEv?`, and `*RST` leaves it.
"""

REPORTED = {
    "sample_rate": "HORizontal:MODE:SAMPLERate?",
    "record_length": "HORizontal:MODE:RECOrdlength?",
    "acquisition_mode": "ACQuire:MODe?",
    "trigger_source": "TRIGger:A:EDGE:SOUrce?",
    "trigger_coupling": "TRIGger:A:EDGE:COUPling?",
    "trigger_holdoff": "TRIGger:A:HOLDoff:BY?",
}
"""What the manifest has of the instrument."""
WORDS = ("mode", "source", "coupling", "holdoff")
"""What their names end in where the answer is no number."""
REPORTED_OF_CHANNEL = {
    "scale_v_per_div": "SCAle?",
    "offset_v": "OFFSet?",
    "position_div": "POSition?",
    "bandwidth_hz": "BANdwidth?",
    "coupling": "COUPling?",
    "inverted": "INVert?",
    "deskew_s": "DESKew?",
    "external_attenuation": "PROBEFunc:EXTAtten?",
    "termination_ohm": "TERmination?",
}
"""What the manifest has of each of its inputs."""
SENT_ANEW = (
    "sample_rate",
    "record_length",
    "acquisition_mode",
    "trigger_*",
    "ch?_*_v*",
    "ch?_position_div",
    "ch?_bandwidth_hz",
    "ch?_coupling",
    "ch?_inverted",
    "ch?_deskew_s",
    "ch?_external_attenuation",
    "ch?_termination_ohm",
)
"""Which of them every run sends."""


def configuration(
    timebase: Timebase, trigger: EdgeTrigger, channels: tuple[int, ...], frames: int, bandwidth_hz: float
) -> Iterator[Setting]:
    """Everything but the vertical ranges, in an order in which no setting undoes one before it.

    FastFrame comes before the record length, which it allows to be shorter, and the channels before the sample rate,
    which more than two of them limit. `DATa:STOP` cuts a record that is longer than was asked for to its first points.
    """
    yield from PLAIN
    yield Setting("FASTAcq:STATE", "OFF")
    yield Setting("ACQuire:SAMPlingmode", "RT")
    yield Setting("ACQuire:SYNcsamples", "OFF")
    yield Setting("ACQuire:STOPAfter", "SEQuence")
    yield Setting("ACQuire:MODe", "SAMple")
    for channel in INPUTS:
        yield Setting(f"SELect:CH{channel}", str(int(channel in channels)))
    yield Setting("HORizontal:MODE", "MANual")
    rate = timebase.sample_rate
    yield Setting("HORizontal:MODE:SAMPLERate", f"{rate:.6E}", RATE_TOLERANCE * rate, "S/s")
    yield from (single_records(timebase) if frames == 1 else many_frames(timebase, frames))
    yield from _delay(timebase)
    for channel in channels:
        yield from input_conversion(channel, bandwidth_hz)
        yield Setting(f"CH{channel}:BANdwidth:ENHanced", "AUTO")
        yield Setting(f"CH{channel}:VTERm:BIAS", "0", unit="V")
    yield from _trigger(trigger)
    yield Setting("DATa:STARt", "1")
    yield Setting("DATa:STOP", str(timebase.samples))
    yield Setting("DATa:ENCdg", "SRIbinary")
    yield Setting("WFMOutpre:BYT_Nr", "1")


def single_records(timebase: Timebase) -> tuple[Setting, ...]:
    """A record at each start."""
    return Setting("HORizontal:FASTframe:STATE", "OFF"), _record_length(timebase)


def framed_records(timebase: Timebase) -> tuple[Setting, ...]:
    """FastFrame, in which records may have 50 or 250 points as well, and no frame is a summary of the others."""
    return (
        Setting("HORizontal:FASTframe:STATE", "ON"),
        _record_length(timebase),
        Setting("HORizontal:FASTframe:SUMFrame", "NONe"),
        Setting("HORizontal:FASTframe:SEQuence", "FIRst"),
    )


def many_frames(timebase: Timebase, frames: int) -> tuple[Setting, ...]:
    """So many records at each start, all of which are transferred."""
    return (
        *framed_records(timebase),
        Setting("HORizontal:FASTframe:COUNt", str(frames), unit="frames"),
        Setting("DATa:FRAMESTARt", "1"),
        Setting("DATa:FRAMESTOP", str(frames)),
    )


def vertical_range(channel: int, vertical: Vertical) -> tuple[Setting, ...]:
    """Scale, position and offset of a channel, with the trace at mid-screen.

    Four digits, because replies carry five: a range can then be set again from what its preamble said, exactly.
    """
    scale = vertical.scale_v_per_div
    return (
        Setting(f"CH{channel}:SCAle", f"{scale:.3E}", SCALE_TOLERANCE * scale, "V/div"),
        Setting(f"CH{channel}:POSition", "0"),
        Setting(f"CH{channel}:OFFSet", f"{vertical.offset_v:.3E}", OFFSET_TOLERANCE_DIV * scale, "V"),
    )


def reported(link: VisaLink, asked: Mapping[str, str]) -> dict[str, str | float]:
    """How the instrument is set: what is asked of it by name, and every channel.

    Raises:
        InstrumentError: it does not say it.
    """
    names = {question: name for name, question in asked.items()}
    for channel in INPUTS:
        names |= {f"CH{channel}:{question}": f"ch{channel}_{name}" for name, question in REPORTED_OF_CHANNEL.items()}
    answers = link.query(";:".join((*(setting.message for setting in PLAIN), *names))).split(";")
    report = {
        name: answer if name.endswith(WORDS) else number_in(answer)
        for name, answer in zip(names.values(), answers, strict=False)
    }
    if len(answers) != len(names) or None in report.values():
        raise InstrumentError(
            f"{link.name} at {link.resource}: does not say in numbers how it is set: check that the driver fits the "
            f"instrument"
        )
    return {name: value for name, value in report.items() if value is not None}


def _record_length(timebase: Timebase) -> Setting:
    length = str(timebase.samples)
    return Setting("HORizontal:MODE:RECOrdlength", length, unit="samples", surplus=MOST_SURPLUS)


def _delay(timebase: Timebase) -> tuple[Setting, ...]:
    """The instrument rounds a delay: where the points lie then, PT_Off and XZEro say."""
    if timebase.delay_s == 0:
        return (Setting("HORizontal:MAIn:DELay:MODe", "OFF"), Setting("HORizontal:POSition", "0"))
    return (
        Setting("HORizontal:MAIn:DELay:MODe", "ON"),
        Setting("HORizontal:MAIn:DELay:POSition", "0"),
        Setting("HORizontal:MAIn:DELay:TIMe", f"{timebase.delay_s:.6E}", 1 / timebase.sample_rate, "s"),
    )


def input_conversion(channel: int, bandwidth_hz: float) -> tuple[Setting, ...]:
    """What of a channel, beside its range, changes volts or time."""
    return (
        Setting(f"CH{channel}:TERmination", str(TERMINATION_OHM), 1.0, "Ohm"),
        Setting(f"CH{channel}:INVert", "OFF"),
        Setting(f"CH{channel}:COUPling", "DC"),
        Setting(f"CH{channel}:BANdwidth", f"{bandwidth_hz:.3E}", bandwidth_hz / 2, "Hz"),
        Setting(f"CH{channel}:DESKew", "0"),
        Setting(f"CH{channel}:PROBEFunc:EXTAtten", "1"),
    )


def _trigger(trigger: EdgeTrigger) -> tuple[Setting, ...]:
    source, suffix = ("AUXiliary", "AUX") if trigger.source == "AUX" else (f"CH{trigger.source}",) * 2
    level = "TRIGger:AUXLevel" if trigger.source == "AUX" else f"TRIGger:A:LEVel:{source}"
    return (
        Setting("TRIGger:A:TYPe", "EDGE"),
        Setting("TRIGger:A:MODe", "NORMal"),
        Setting("TRIGger:A:HOLDoff:BY", "DEFAult"),
        Setting("TRIGger:A:EDGE:COUPling", "DC"),
        Setting("TRIGger:A:EDGE:SOUrce", source),
        Setting(f"TRIGger:A:EDGE:SLOpe:{suffix}", "RISe" if trigger.rising else "FALL"),
        Setting(level, f"{trigger.level_v:.4f}", LEVEL_TOLERANCE_V, "V"),
    )
