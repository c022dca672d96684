"""What a 6 Series B MSO is set to, and what it is asked about how it is set.

Commands: programmer manual of the 4/5/6 Series MSO, as the descriptions of the package tm_devices have it (MSO6B). What
it says of `CH<x>:SCAle`, `CH<x>:POSition` and `VERBose` is "sets or returns"; its syntax lists the setting alone.
"""

from collections.abc import Iterator

from instruments.kept_settings import Setting
from instruments.tektronix_dpo72504dx_settings import (
    INPUTS,
    LEVEL_TOLERANCE_V,
    MOST_SURPLUS,
    PLAIN,
    RATE_TOLERANCE,
    input_conversion,
)
from instruments.values import EdgeTrigger, Timebase

HOLDOFF_TOLERANCE_S = 1e-6

REPORTED = {
    "sample_rate": "HORizontal:MODe:SAMPLERate?",
    "record_length": "HORizontal:MODe:RECOrdlength?",
    "acquisition_mode": "ACQuire:MODe?",
    "trigger_source": "TRIGger:A:EDGE:SOUrce?",
    "trigger_coupling": "TRIGger:A:EDGE:COUPling?",
    "trigger_holdoff_s": "TRIGger:A:HOLDoff:TIMe?",
}
"""What the manifest has of the instrument."""


def acquisition(timebase: Timebase, channels: tuple[int, ...]) -> Iterator[Setting]:
    """Channels and time base but for the record, in an order in which no setting undoes one before it.

    A sequence is one acquisition, and a new sample rate leaves the record as long as it is.
    """
    yield from PLAIN
    yield Setting("ACQuire:FASTAcq:STATE", "OFF")
    yield Setting("ACQuire:FASTAVerage:STATE", "OFF")
    yield Setting("ACQuire:STOPAfter", "SEQuence")
    yield Setting("ACQuire:SEQuence:NUMSEQuence", "1")
    yield Setting("ACQuire:MODe", "SAMple")
    for channel in INPUTS:
        yield Setting(f"DISplay:GLObal:CH{channel}:STATE", str(int(channel in channels)))
    yield Setting("HORizontal:MODe", "MANual")
    yield Setting("HORizontal:MODe:MANual:CONFIGure", "HORIZontalscale")
    rate = timebase.sample_rate
    yield Setting("HORizontal:MODe:SAMPLERate", f"{rate:.6E}", RATE_TOLERANCE * rate, "S/s")


def single_records(timebase: Timebase) -> tuple[Setting, ...]:
    """A record at each start."""
    return Setting("HORizontal:FASTframe:STATE", "OFF"), _record_length(timebase)


def framed_records(timebase: Timebase) -> tuple[Setting, ...]:
    """FastFrame, in which no frame is a summary of the others."""
    return (
        Setting("HORizontal:FASTframe:STATE", "ON"),
        Setting("HORizontal:FASTframe:SUMFrame", "NONe"),
        _record_length(timebase),
    )


def many_frames(timebase: Timebase, frames: int) -> tuple[Setting, ...]:
    """So many records at each start, all of which are transferred."""
    return (
        *framed_records(timebase),
        Setting("HORizontal:FASTframe:COUNt", str(frames), unit="frames"),
        Setting("DATa:FRAMESTARt", "1"),
        Setting("DATa:FRAMESTOP", str(frames)),
    )


def conversion(
    timebase: Timebase, points: float, trigger: EdgeTrigger, channels: tuple[int, ...], bandwidth_hz: float
) -> Iterator[Setting]:
    """Delay of records of so many points, inputs, trigger and transfer.

    `DATa:STOP` cuts a record that is longer than was asked for to its first points.
    """
    yield from _delay(timebase, points)
    for channel in channels:
        yield from input_conversion(channel, bandwidth_hz)
        yield Setting(f"CH{channel}:BANdwidth:FILTer:OPTIMIZation", "STEPRESPONSE")
    yield from _trigger(trigger)
    yield Setting("DATa:RESample", "1")
    yield Setting("DATa:STARt", "1")
    yield Setting("DATa:STOP", str(timebase.samples))
    yield Setting("DATa:ENCdg", "SRIbinary")
    yield Setting("WFMOutpre:BYT_Nr", "2")


def _record_length(timebase: Timebase) -> Setting:
    """Records begin at 1000 points (data sheet of the 6 Series B, recalled)."""
    length = str(timebase.samples)
    return Setting("HORizontal:MODe:RECOrdlength", length, unit="samples", surplus=MOST_SURPLUS)


def _delay(timebase: Timebase, points: float) -> tuple[Setting, ...]:
    """Delay mode puts the delayed point at 50 % of the record; where the points lie then, PT_Off and XZEro say."""
    if timebase.delay_s == 0:
        return (Setting("HORizontal:DELay:MODe", "OFF"), Setting("HORizontal:POSition", "0"))
    middle_s = timebase.delay_s + points / 2 / timebase.sample_rate
    return (
        Setting("HORizontal:DELay:MODe", "ON"),
        Setting("HORizontal:DELay:TIMe", f"{middle_s:.6E}", 1 / timebase.sample_rate, "s"),
    )


def _trigger(trigger: EdgeTrigger) -> tuple[Setting, ...]:
    auxiliary = trigger.source == "AUX"
    source = "AUXiliary" if auxiliary else f"CH{trigger.source}"
    level = "TRIGger:AUXLevel" if auxiliary else f"TRIGger:A:LEVel:{source}"
    return (
        Setting("TRIGger:A:TYPe", "EDGE"),
        Setting("TRIGger:A:MODe", "NORMal"),
        Setting("TRIGger:A:HOLDoff:BY", "TIMe"),
        Setting("TRIGger:A:HOLDoff:TIMe", "0", HOLDOFF_TOLERANCE_S, "s"),
        Setting("TRIGger:A:EDGE:COUPling", "DC"),
        Setting("TRIGger:A:EDGE:SOUrce", source),
        Setting("TRIGger:A:EDGE:SLOpe", "RISe" if trigger.rising else "FALL"),
        Setting(level, f"{trigger.level_v:.4f}", LEVEL_TOLERANCE_V, "V"),
    )
