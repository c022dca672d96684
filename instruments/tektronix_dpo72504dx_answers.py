"""Where the documents of a DPO72504DX leave a question open: what this one does, measured in the dark.

The questions: whether records of 50 points need FastFrame ("permitted in addition" there, by the manual's
HORizontal:MODE:RECOrdlength), and whether the preamble's zero moves with unsigned codes (WFMOutpre:YZEro says that it
combines YOFf, and not how under RP).
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from instruments.tektronix_dpo72504dx_settings import PLAIN
from instruments.values import Answer
from instruments.visa import VisaLink, number_in

SHORTEST_ALONE, SHORTEST_FRAMED = 500, 50
POINTS = 500
UNSIGNED_AHEAD = -128


def answers(link: VisaLink) -> Iterator[Answer]:
    """Ask the instrument behind `link`; the settings that this takes are set again before every run."""
    replies = (setting.message for setting in PLAIN)
    for message in (*replies, "ACQuire:STATE STOP", "HORizontal:MODE MANual", "ACQuire:STOPAfter SEQuence"):
        link.write(message)
    yield _shortest(link, "OFF", "shortest record of a single trigger", SHORTEST_ALONE)
    yield _shortest(link, "ON", "shortest record in FastFrame", SHORTEST_FRAMED)
    yield _zero(link)


def _shortest(link: VisaLink, framed: str, question: str, assumed: int) -> Answer:
    link.write(f"HORizontal:FASTframe:STATE {framed}")
    link.write(f"HORizontal:MODE:RECOrdlength {SHORTEST_FRAMED}")
    found = link.number("HORizontal:MODE:RECOrdlength?")
    return Answer(question, f"{assumed} points", f"{found:g} points", found == assumed)


def _zero(link: VisaLink) -> Answer:
    """One record, read with signed and with unsigned codes: how far apart its volts are."""
    for message in (
        "HORizontal:FASTframe:STATE OFF",
        f"HORizontal:MODE:RECOrdlength {POINTS}",
        "SELect:CH1 ON",
        "DATa:SOUrce CH1",
        "DATa:STARt 1",
        f"DATa:STOP {POINTS}",
        "WFMOutpre:BYT_Nr 1",
        "ACQuire:STATE RUN",
        "TRIGger FORCe",
    ):
        link.write(message)
    link.query("*OPC?")
    apart = _volts(link, "SRIbinary", np.empty(POINTS, np.int8)) - _volts(link, "SRPbinary", np.empty(POINTS, np.uint8))
    link.write("DATa:ENCdg SRIbinary")
    step = abs(link.number("WFMOutpre:YMUlt?"))
    moved = float(apart.mean()) / step
    return Answer(
        "codes between volts by signed and by unsigned codes, each with its own preamble",
        f"{UNSIGNED_AHEAD}: the preamble's zero does not move with the format",
        f"{moved:.4g}",
        abs(moved - UNSIGNED_AHEAD) < 1 / 2,
    )


def _volts(link: VisaLink, encoding: str, codes: NDArray[np.int8] | NDArray[np.uint8]) -> NDArray[np.float64]:
    questions = (f"DATa:ENCdg {encoding}", *(f"WFMOutpre:{field}?" for field in ("YMUlt", "YZEro", "YOFf")), "CURVe?")
    multiplier, zero, offset = (number_in(answer) or 0.0 for answer in link.read_described_block(questions, codes))
    volts: NDArray[np.float64] = (codes.astype(np.float64) - offset) * multiplier + zero
    return volts
