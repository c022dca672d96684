"""The settings that another client changes: what it sends, to whom, and by which words a person is told of it."""

from dataclasses import dataclass
from unittest.mock import patch

import numpy as np

from tests.knobs.interloper import VisitedBench

DRIVE = '"pseudorandom"'
LARGEST_SCALE_V = 0.6


@dataclass(frozen=True)
class Knob:
    """One setting, changed.

    Attributes:
        role: the instrument.
        name: for people.
        sent: the lines that another client sends it.
        word: what a line that names the setting has in it, in small letters.
        factor: the number that `sent` asks for is set again, so many times as large; None: `sent` changes it.
        harmless: no record depends on it.
        burst_only: it is there in bursts only.
        long_drive: it makes the drive so long that the twin takes a while to find its light.
    """

    role: str
    name: str
    sent: bytes
    word: str
    factor: float | None = None
    harmless: bool = False
    burst_only: bool = False
    long_drive: bool = False

    @property
    def answered(self) -> bool:
        """Whether every instrument goes on answering, if only after a while."""
        return self.harmless or self.long_drive

    def befalls(self, bench: VisitedBench) -> None:
        """The other client does it; it must be something that the instrument accepts."""
        lines = self.sent
        if self.factor is not None:
            lines += b" %.6E" % min(LARGEST_SCALE_V, self.factor * float(bench.say(self.role, lines + b"?")))
        refused = AssertionError(f"{self.role} {self.name}: the instrument refuses it")
        with patch.object(bench.virtual(self.role).status, "report", side_effect=refused):
            answers = bench.say(self.role, lines)
        assert self.role != "dmd" or not answers.strip(b"0"), f"{self.role} {self.name}: {answers!r}"


def _scope(name: str, sent: str, word: str, factor: float | None = None, *, harmless: bool = False) -> Knob:
    return Knob("scope", name, sent.encode(), word, factor, harmless)


def _awg(name: str, sent: str, word: str, *, harmless: bool = False) -> Knob:
    return Knob("awg", name, sent.encode(), word, None, harmless)


def _other_waveform(*, with_marker: bool) -> bytes:
    samples = np.random.default_rng(9).uniform(-1, 1, 2500).astype("<f4").tobytes()
    marker = bytes([0x40]) * 100 + bytes(2400)
    lines = [
        b'WLISt:WAVeform:NEW "other",2500',
        b'WLISt:WAVeform:DATA "other",0,2500,#510000' + samples,
        b'WLISt:WAVeform:MARKer:DATA "other",0,2500,#42500' + marker,
        b'SOURce1:CASSet:WAVeform "other"',
    ]
    return b"\n".join(lines if with_marker else [lines[0], lines[1], lines[3]])


KNOBS = (
    _scope("vertical scale twice as large", "CH1:SCAle", "scale", 2.0),
    _scope("vertical scale half as large", "CH2:SCAle", "scale", 0.5),
    _scope("vertical scale a little larger", "CH2:SCAle", "scale", 1.3),
    _scope("vertical offset", "CH1:OFFSet 0.05", "offset"),
    _scope("vertical position", "CH1:POSition 2", "position"),
    _scope("invert", "CH1:INVert ON", "invert"),
    _scope("bandwidth", "CH1:BANdwidth 1E9", "bandwidth"),
    _scope("bandwidth not enhanced", "CH1:BANdwidth:ENHanced OFF", "enhanced", harmless=True),
    _scope("coupling GND", "CH1:COUPling GND", "coupling"),
    _scope("deskew", "CH1:DESKew 80E-12", "deskew"),
    _scope("external attenuation", "CH1:PROBEFunc:EXTAtten 10", "atten"),
    _scope("external attenuation in decibels", "CH2:PROBEFunc:EXTDBatten 6", "atten"),
    _scope("channel off", "SELect:CH1 OFF", "select"),
    _scope("another channel on", "SELect:CH3 ON", "select"),
    _scope(
        "three channels and the highest rate",
        "SELect:CH3 ON;:HORizontal:MODE MANual;:HORizontal:MODE:SAMPLERate 50E9",
        "sampler",
    ),
    _scope("sample rate twice as high", "HORizontal:MODE MANual;:HORizontal:MODE:SAMPLERate 50E9", "sampler"),
    _scope("sample rate half as high", "HORizontal:MODE MANual;:HORizontal:MODE:SAMPLERate 12.5E9", "sampler"),
    _scope("record length", "HORizontal:MODE MANual;:HORizontal:MODE:RECOrdlength 6000", "reco"),
    _scope("length of a frame", "HORizontal:MODE MANual;:HORizontal:FASTframe:LENgth 250", "reco"),
    _scope("horizontal mode", "HORizontal:MODE AUTO;:HORizontal:MODE:SCAle 1E-9", "mode"),
    _scope("horizontal position", "HORizontal:POSition 20", "position"),
    _scope("delay", "HORizontal:MAIn:DELay:MODe ON;POSition 0;TIMe 2E-9", "delay"),
    _scope("trigger slope", "TRIGger:A:EDGE:SLOpe:AUX FALL", "slo"),
    _scope("trigger level in reach", "TRIGger:AUXLevel 0.7", "level", harmless=True),
    _scope("trigger level out of reach", "TRIGger:AUXLevel 3", "level"),
    _scope("trigger source", "TRIGger:A:EDGE:SOUrce CH1", "source"),
    _scope("trigger from the mains", "TRIGger:A:EDGE:SOUrce LINE", "source"),
    _scope("trigger mode", "TRIGger:A:MODe AUTO", "mode", harmless=True),
    _scope("trigger coupling", "TRIGger:A:EDGE:COUPling AC", "coupling", harmless=True),
    _scope("trigger hold-off", "TRIGger:A:HOLDoff:BY TIMe;TIMe 1E-3", "holdoff", harmless=True),
    _scope("acquisition mode average", "ACQuire:MODe AVErage", "mode"),
    _scope("acquisition mode envelope", "ACQuire:MODe ENVelope", "mode"),
    _scope("acquisition mode sample", "ACQuire:MODe SAMple", "mode"),
    _scope(
        "acquisition mode high resolution",
        "HORizontal:MODE MANual;:HORizontal:MODE:SAMPLERate 3E9;:ACQuire:MODe HIRes",
        "mode",
    ),
    _scope("number of averages", "ACQuire:NUMAVg 2", "numav"),
    _scope("samples aligned to the trigger", "ACQuire:SYNcsamples ON", "syn", harmless=True),
    _scope("stop after", "ACQuire:STOPAfter RUNSTop", "stopafter"),
    _scope("stopped", "ACQuire:STATE STOP", "state"),
    _scope("started", "ACQuire:STATE RUN", "state", harmless=True),
    _scope("encoding RPBinary", "DATa:ENCdg RPBinary", "enc"),
    _scope("encoding most significant byte first", "DATa:ENCdg RIBinary", "enc"),
    _scope("encoding ASCII", "DATa:ENCdg ASCIi", "enc"),
    _scope("number format", "WFMOutpre:BN_Fmt RP", "bn_fmt"),
    _scope("bytes a point", "WFMOutpre:BYT_Nr 2", "byt"),
    _scope("one byte a point", "WFMOutpre:BYT_Nr 1", "byt"),
    _scope("byte order", "WFMOutpre:BYT_Or MSB", "byt"),
    _scope("first and last point", "DATa:STARt 3;STOP 42", "star"),
    _scope("last point", "DATa:STOP 20", "stop"),
    _scope("transfer as at the factory", "DATa INIT", "data"),
    _scope("source of the data", "DATa:SOUrce CH2", "source"),
    _scope("sources of the data", "DATa:SOUrce CH1,CH2", "source"),
    _scope("FastFrame", "HORizontal:FASTframe:STATE ON;COUNt 3", "fastframe"),
    _scope("FastFrame off", "HORizontal:FASTframe:STATE OFF", "fastframe"),
    _scope("FastFrame summary", "HORizontal:FASTframe:SUMFrame AVErage", "sumframe"),
    _scope("number of frames", "HORizontal:FASTframe:COUNt 4", "coun"),
    _scope("last frames", "HORizontal:FASTframe:SEQuence LAST", "sequence"),
    _scope("first frame to send", "DATa:FRAMESTARt 2", "frame"),
    _scope("headers", "HEADer ON", "header"),
    _scope("short words", "VERBose OFF", "verbose", harmless=True),
    _scope("channel label", 'CH1:LABel "mine"', "label", harmless=True),
    _scope("termination", "CH1:TERmination 50", "termination", harmless=True),
    _scope("termination voltage", "CH1:VTERm:BIAS 0.5", "bias", harmless=True),
    _scope("display", "DISplay:WAVEform OFF", "display", harmless=True),
    _scope("scale of a channel that is off", "CH4:SCAle 0.2", "scale", harmless=True),
    _scope("status cleared", "*CLS", "cls", harmless=True),
    _scope("events masked", "DESE 0", "dese", harmless=True),
    _scope("reset", "*RST", "scope"),
    _scope("acquisitions cleared", "CLEAR ALL", "scope"),
    _awg("amplitude", "SOURce1:VOLTage 0.3", "amplitude"),
    _awg("sample rate", "CLOCk:SRATe 24E9", "rate"),
    _awg("clock source", "CLOCk:SOURce EXTernal", "clock"),
    _awg("clock from a reference", "CLOCk:SOURce EFIXed", "clock"),
    _awg("DAC resolution", "SOURce1:DAC:RESolution 8", "resolution"),
    _awg("DAC resolution without marker", "SOURce1:DAC:RESolution 10", "resolution"),
    _awg("waveform inverted in place", f"WLISt:WAVeform:INVert {DRIVE}", "waveform"),
    _awg("waveform shifted in place", f"WLISt:WAVeform:ROTate:POINts {DRIVE},5", "waveform"),
    _awg("samples overwritten", f"WLISt:WAVeform:DATA {DRIVE},1200,2,#18\0\0\0\0\0\0\0\0", "waveform"),
    _awg("waveform resampled", f"WLISt:WAVeform:RESample {DRIVE},5000", "waveform"),
    _awg("waveform deleted", f"WLISt:WAVeform:DELete {DRIVE}", "waveform"),
    Knob("awg", "another waveform", _other_waveform(with_marker=True), "waveform"),
    Knob("awg", "another waveform without marker", _other_waveform(with_marker=False), "waveform"),
    _awg("marker data", f"WLISt:WAVeform:MARKer:DATA {DRIVE},0,100,#3100" + "\0" * 100, "waveform"),
    _awg("marker delay", "SOURce1:MARKer1:DELay 100E-12", "delay"),
    _awg("marker level in reach", "SOURce1:MARKer1:VOLTage:HIGH 0.9", "marker", harmless=True),
    _awg("marker level out of reach", "SOURce1:MARKer1:VOLTage:HIGH 0.5", "marker"),
    _awg("skew", "SOURce1:SKEW 100E-12", "skew"),
    _awg("run mode", "SOURce1:RMODe TRIGgered", "mode"),
    _awg("run mode continuous", "SOURce1:RMODe CONTinuous", "mode"),
    _awg("instrument mode", "INSTrument:MODE FGEN", "mode"),
    _awg("output off", "OUTPut1 OFF", "output"),
    _awg("all outputs off", "OUTPut:OFF ON", "output"),
    _awg("stopped", "AWGControl:STOP", "state"),
    _awg("trigger level", "TRIGger:LEVel 4,ATRigger", "level"),
    _awg("trigger slope", "TRIGger:SLOPe POSitive,ATRigger", "slope"),
    _awg("trigger input", "SOURce1:TINPut BTRigger", "input"),
    Knob("awg", "trigger source", b"TRIGger:SOURce INTernal", "source", long_drive=True),
    _awg("trigger impedance", "TRIGger:IMPedance 1000,ATRigger", "impedance", harmless=True),
    _awg("trigger timing", "TRIGger:MODE SYNChronous,ATRigger", "mode", harmless=True),
    _awg("the other channel", "SOURce2:VOLTage 0.3", "amplitude", harmless=True),
    _awg("the other channel on", "OUTPut2 ON", "channel 2", harmless=True),
    _awg("status cleared", "*CLS", "cls", harmless=True),
    _awg("reset", "*RST", "awg"),
    Knob("laser", "power lower", b"POWER 12", "power"),
    Knob("laser", "power higher", b"POWER 15.5", "power"),
    Knob("laser", "wavelength", b"WAVELENGTH 1551", "wavelength"),
    Knob("laser", "wavelength by a little", b"WAVELENGTH 1550.05", "wavelength"),
    Knob("laser", "off", b"OUTPUT OFF", "laser"),
    Knob("laser", "reset", b"*RST", "laser"),
    Knob("patch_panel", "another port", b"ROUTe:CLOSe (@1!9)", "channel"),
    Knob("patch_panel", "two ports swapped", b"ROUTe:OPEN:ALL\nROUTe:CLOSe (@1!3,2!2)", "channel"),
    Knob("patch_panel", "port taken off", b"ROUTe:OPEN (@2)", "channel"),
    Knob("patch_panel", "all taken off", b"ROUTe:OPEN:ALL", "channel"),
    Knob("patch_panel", "a channel nobody reads", b"ROUTe:CLOSe (@4!9)", "channel", harmless=True),
    Knob("dmd", "halted", b"ALP:PROJHALT", "dmd"),
    Knob("dmd", "mirrors parked", b"ALP:DEVHALT", "dmd"),
    Knob("dmd", "mirrors released", b"ALP:PROJHALT\nALP:DEVCONTROL 2064,1", "dmd"),
    Knob("dmd", "sequence freed", b"ALP:DEVHALT\nALP:SEQFREE 1", "dmd"),
    Knob("dmd", "device freed", b"ALP:DEVHALT\nALP:DEVFREE", "dmd"),
    Knob("dmd", "pictures inverted", b"ALP:PROJHALT\nALP:PROJCONTROL 2306,1", "dmd"),
    Knob("dmd", "pictures upside down", b"ALP:PROJHALT\nALP:PROJCONTROL 2307,1", "dmd"),
    Knob("dmd", "slave mode", b"ALP:PROJHALT\nALP:PROJCONTROL 2300,2302", "dmd"),
    Knob("dmd", "data format", b"ALP:PROJHALT\nALP:SEQCONTROL 1,2110,3", "dmd"),
    Knob("dmd", "picture time", b"ALP:PROJHALT\nALP:SEQTIMING 2,0,100,0,0,0", "dmd", burst_only=True),
    Knob("dmd", "synch polarity", b"ALP:PROJHALT\nALP:DEVCONTROL 2004,2007", "dmd"),
)
"""Every setting of the table, in its order."""
