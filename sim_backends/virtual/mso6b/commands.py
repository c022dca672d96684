"""What the virtual 6 Series B understands.

Source: the descriptions of MSO6B commands in the package tm_devices, which its maker generates from the programmer
manual of the 4/5/6 Series MSO. Where the words of a family differ from the DPO70000's, these are the family's.
"""

from sim_backends.scpi.arguments import boolean, integer, keyword, quoted, real, run_or_stop, several
from sim_backends.scpi.commands import Action, Query, Setting
from sim_backends.virtual.mso6b.model import BANDWIDTH_HZ, RECORDS
from sim_backends.virtual.oscilloscope.fastframe import MOST_FRAMES
from sim_backends.virtual.oscilloscope.transfer import LAST_POINT, PREAMBLE
from sim_backends.virtual.oscilloscope.trigger import TRIGGER_LIMIT_V, TRIGGER_SOURCES
from sim_backends.virtual.oscilloscope.vertical import CHANNELS, DESKEW_LIMIT_S, OFFSET_LIMIT_V

LOWEST_SCALE_V, HIGHEST_SCALE_V = 1e-3, 1.0  # V/div into 50 ohm, recalled
LOWEST_BANDWIDTH_HZ = 20e6  # recalled
HIGHEST_ATTENUATION = 1e10

_RATE = real(RECORDS.rates[-1] / 2, 2 * RECORDS.rates[0])
_LENGTH = integer(1, RECORDS.longest)
_FRAME = integer(1, MOST_FRAMES)
_LEVEL = real(-TRIGGER_LIMIT_V, TRIGGER_LIMIT_V, ECL=-1.3, TTL=1.4)
_SOURCE = keyword(*CHANNELS, *(f"{kind}{number}" for kind in ("MATH", "REF") for number in (1, 2, 3, 4)))

_VERTICAL = (
    Setting("DISplay:GLObal:CH#:STATE", "channels#.selected", boolean),
    Setting("CH#:SCAle", "channels#.scale_v", real(LOWEST_SCALE_V, HIGHEST_SCALE_V)),
    Setting("CH#:OFFSet", "channels#.offset_v", real(-OFFSET_LIMIT_V, OFFSET_LIMIT_V)),
    Setting("CH#:POSition", "channels#.position_div", real(-5, 5)),
    Setting("CH#:BANdwidth", "channels#.bandwidth_hz", real(LOWEST_BANDWIDTH_HZ, BANDWIDTH_HZ, FULl=BANDWIDTH_HZ)),
    Setting("CH#:COUPling", "channels#.coupling", keyword("AC", "DC", "DCR")),
    Setting("CH#:TERmination", "channels#.termination_ohm", real(50, 50), effect=False),
    Setting("CH#:INVert", "channels#.inverted", boolean),
    Setting("CH#:DESKew", "channels#.deskew_s", real(-DESKEW_LIMIT_S, DESKEW_LIMIT_S)),
    Setting("CH#:LABel:NAMe", "channels#.label", quoted, effect=False),
    Setting("CH#:PROBEFunc:EXTAtten", "channels#.attenuation", real(1 / HIGHEST_ATTENUATION, HIGHEST_ATTENUATION)),
    Setting("CH#:PROBEFunc:EXTDBatten", "channels#.attenuation_db", real(-200, 200)),
)
_HORIZONTAL = (
    Setting("HORizontal:MODe", "horizontal.mode", keyword("AUTO", "MANual")),
    Setting("HORizontal:MODe:MANual:CONFIGure", "horizontal.follows", keyword("HORIZontalscale", "RECORDLength")),
    Setting("HORizontal:MODe:SAMPLERate", "horizontal.sample_rate", _RATE),
    Setting("HORizontal:SAMPLERate", "horizontal.sample_rate", _RATE),
    Setting("HORizontal:MODe:RECOrdlength", "horizontal.record_length", _LENGTH),
    Setting("HORizontal:RECOrdlength", "horizontal.record_length", _LENGTH),
    Setting("HORizontal:MODe:SCAle", "horizontal.scale_s", real(1e-12, 1000)),
    Setting("HORizontal:SCAle", "horizontal.scale_s", real(1e-12, 1000)),
    Setting("HORizontal:POSition", "horizontal.position_percent", real(0, 100)),
    Setting("HORizontal:DELay:MODe", "horizontal.delayed", boolean),
    Setting("HORizontal:DELay:TIMe", "horizontal.delay_s", real(-1, 1)),
    Setting("HORizontal:ACQDURATION?", "horizontal.duration_s", real()),
    Setting("HORizontal:DIVisions?", "horizontal.divisions", integer()),
    Setting("HORizontal:MAIn:INTERPRatio?", "horizontal.interpolation", integer()),
)
_FASTFRAME = (
    Setting("HORizontal:FASTframe:STATE", "frames.on", boolean),
    Setting("HORizontal:FASTframe:COUNt", "frame_count", _FRAME),
    Query("HORizontal:FASTframe:MAXFRames?", "most_frames"),
    Setting("HORizontal:FASTframe:SUMFrame", "frames.summary", keyword("NONe", "AVErage", "ENVelope")),
)
_TRIGGER = (
    Setting("TRIGger:A:TYPe", "trigger.type", keyword("EDGE"), effect=False),
    Setting("TRIGger:A:MODe", "trigger.mode", keyword("AUTO", "NORMal")),
    Setting("TRIGger:A:EDGE:SOUrce", "trigger.source", keyword(*TRIGGER_SOURCES)),
    Setting("TRIGger:A:EDGE:SLOpe", "trigger_slope", keyword("RISe", "FALL", "EITher")),
    Setting("TRIGger:A:EDGE:COUPling", "trigger.coupling", keyword("DC", "HFRej", "LFRej", "NOISErej")),
    Setting("TRIGger:A:LEVel:CH#", "trigger.inputs#.level_v", _LEVEL),
    Setting("TRIGger:AUXLevel", "trigger.auxiliary.level_v", _LEVEL),
    Setting("TRIGger:A:HOLDoff:BY", "trigger.holdoff_by", keyword("TIMe", "RANDom")),
    Setting("TRIGger:A:HOLDoff:TIMe", "trigger.holdoff_s", real(0, 10)),
)
_MODE = (
    Setting("ACQuire:STOPAfter", "mode.stop_after", keyword("RUNSTop", "SEQuence")),
    Setting("ACQuire:MODe", "mode.chosen", keyword("SAMple", "PEAKdetect", "HIRes", "AVErage", "ENVelope")),
    Setting("ACQuire:NUMAVg", "mode.averages", integer(2, 10240)),
)

PLANNED_BY = frozenset((*_VERTICAL, *_HORIZONTAL, *_FASTFRAME, *_TRIGGER, *_MODE))
"""What changes how samples are taken."""

COMMANDS = (
    Setting("HEADer", "headers", boolean),
    Setting("VERBose", "verbose", boolean),
    Query("ID?", "short_identity"),
    Query("ALLEv?", "status.all_texts"),
    Query("EVMsg?", "status.next_text"),
    Query("EVENT?", "status.next_code"),
    Query("EVQty?", "status.count"),
    Setting("DESE", "status.enabled", integer(0, 255)),
    Setting("*PSC", "clears_at_power_on", boolean, effect=False),
    Action("FACtory", "restore_factory_settings"),
    *_VERTICAL,
    Setting(
        "CH#:BANdwidth:FILTer:OPTIMIZation",
        "filter_shapes#.optimised_for",
        keyword("STEPRESPONSE", "FLATNESS"),
        effect=False,
    ),
    *_HORIZONTAL,
    *_FASTFRAME,
    Query("HORizontal:FASTframe:TIMEStamp:ALL?", "time_stamps"),
    Query("HORizontal:FASTframe:XZEro:ALL?", "trigger_offsets"),
    *_TRIGGER,
    Action("TRIGger", "force_trigger", keyword("FORCe")),
    Query("TRIGger:STATE?", "trigger_state"),
    Setting("ACQuire:STATE", "acquiring", run_or_stop),
    *_MODE,
    Setting("ACQuire:SEQuence:NUMSEQuence", "acquisitions_of_a_sequence", integer(1, 1), effect=False),
    Setting("ACQuire:FASTAcq:STATE", "pixel_maps", boolean),
    Setting("ACQuire:FASTAVerage:STATE", "fast_averages", boolean),
    Setting("ACQuire:MAXSamplerate?", "horizontal.highest_rate", real()),
    Query("ACQuire:NUMACq?", "count_acquisitions"),
    Query("ACQuire:NUMFRAMESACQuired?", "count_frames"),
    Query("BUSY?", "busy"),
    Setting("DATa:SOUrce", "transfer.sources", several(_SOURCE)),
    Query("DATa:SOUrce:AVAILable?", "available_sources"),
    Setting("DATa:STARt", "transfer.start", integer(1, LAST_POINT)),
    Setting("DATa:STOP", "transfer.stop", integer(1, LAST_POINT)),
    Setting("DATa:FRAMESTARt", "transfer.frame_start", integer(1, LAST_POINT)),
    Setting("DATa:FRAMESTOP", "transfer.frame_stop", integer(1, LAST_POINT)),
    Setting("DATa:RESample", "every_sample", integer(1, 1), effect=False),
    Setting(
        "DATa:ENCdg",
        "transfer.encoding",
        keyword("ASCIi", "RIBinary", "RPBinary", "FPBinary", "SRIbinary", "SRPbinary", "SFPbinary"),
    ),
    Setting("DATa:WIDth", "transfer.width", integer(1, 2)),
    *PREAMBLE,
    Query("CURVe?", "curve"),
    Action("CLEAR", "forget_acquisitions", keyword("ALL")),
    Setting("DISplay:WAVEform", "display_on", boolean, effect=False),
    Setting("LOCk", "panel_lock", keyword("ALL", "NONe"), effect=False),
    Action("UNLock", "unlock_panel", keyword("ALL"), effect=False),
)
"""Every command."""
