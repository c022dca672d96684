"""Settings of the virtual oscilloscope in groups: queries that tell many at once, and setups that restore all of them.

A setup is the text that `SET?` sends: commands that bring the settings back, whatever they are now. Sources: tm_devices
3.7, descriptions of HORizontal, CH<x>, TRIGger, DATa, SELect, SET, *LRN, *SAV and *RCL; `ACQuire?` is recalled.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from itertools import groupby
from typing import Any, NamedTuple

from sim_backends.scpi.arguments import integer
from sim_backends.scpi.commands import Action, Command, Query, Setting, reply_header
from sim_backends.scpi.messages import Argument, Chunk
from sim_backends.scpi.status import ScpiError

PLACES = 10
"""Memory locations for setups."""

PLACE = integer(1, PLACES)

_BEFORE_OTHERS = ("CH#:PROBEFunc:EXTAtten", "SELect:CH#", "HORizontal:FASTframe:STATE")
"""Settings that change others or what others may be: the attenuation scales volts, channels share the sample rate."""

_BEHIND_OTHERS = ("HORizontal:MODE",)
"""In AUTO and CONStant the rate or the record length cannot be set: a setup sets both in MANual and the mode last."""

_SAID_BY_OTHERS = (
    *("HDR", "CH#:PROBEFunc:EXTDBatten", "HORizontal:MODE:SCAle", "HORizontal:FASTframe:LENgth"),
    *("TRIGger:A:LEVel", "TRIGger:A:EDGE:SLOpe", "DATa:ENCdg", "DATa:WIDth", "WFMOutpre:BIT_Nr"),
)
"""Second names, and settings that follow from others."""

_NO_SETTINGS = ("ACQuire:STATE", "DESE", "*PSC", "FILESystem:CWD")
"""Whether it runs, what it reports and where its files go are no part of a setup."""


class Reading(NamedTuple):
    """One setting as it is: the header of its reply and its value."""

    header: str
    value: str


class Group(Command):
    """A query that answers with every setting below its header."""

    acts = False
    labelled = True

    def execute(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """There is no command form: the answer."""
        return self.answer(instrument, suffixes, arguments)

    def answer(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """The settings, with their headers if the instrument sends headers."""
        if arguments:
            raise ScpiError(-108)
        begin = _nodes(self.header)
        below = [
            command
            for command in instrument.COMMANDS
            if isinstance(command, Setting) and command.answers and _nodes(command.header)[: len(begin)] == begin
        ]
        text = told(readings(instrument, below, tuple(suffixes)), headers=instrument.headers)
        return [text.encode("latin-1", "replace")]


def readings(instrument: Any, settings: Iterable[Setting], suffixes: tuple[int, ...] = ()) -> Iterator[Reading]:
    """What `settings` are, for every suffix behind the given ones; a setting that cannot be told now is left out."""
    for name, together in groupby(settings, lambda setting: _suffixed(setting, len(suffixes))):
        if name:
            some = list(together)
            for number in range(1, instrument.SUFFIXES[name.rpartition(":")[2]] + 1):
                yield from readings(instrument, some, (*suffixes, number))
            continue
        for setting in together:
            with suppress(ScpiError):
                value = b"".join(setting.answer(instrument, suffixes, ())).decode("latin-1")
                yield Reading(reply_header(setting, suffixes, verbose=instrument.verbose), value)


def told(found: Iterable[Reading], *, headers: bool) -> str:
    """Settings as one reply; a header is shortened to what differs from the path of the one before."""
    parts, path = [], None
    for header, value in found:
        before, _, name = header.rpartition(":")
        parts.append(f"{name if before == path else header} {value}" if headers else value)
        path = before
    return ";".join(parts)


def learned(instrument: Any) -> str:
    """Commands that restore every setting as it is now."""
    settings = [
        command
        for command in instrument.COMMANDS
        if isinstance(command, Setting)
        and command.acts
        and command.header not in (*_SAID_BY_OTHERS, *_NO_SETTINGS)
        and command.answers
    ]
    first = [setting for name in _BEFORE_OTHERS for setting in settings if setting.header == name]
    last = [setting for setting in settings if setting.header in _BEHIND_OTHERS]
    others = [setting for setting in settings if setting not in (*first, *last)]
    mode = Reading(reply_header(last[0], (), verbose=instrument.verbose), "MANUAL" if instrument.verbose else "MAN")
    found = (*readings(instrument, first), mode, *readings(instrument, others), *readings(instrument, last))
    return told(found, headers=True)


class Setups:
    """Setups in memory.

    Args:
        learn: The present setup.
        obey: Executes a setup.
    """

    def __init__(self, learn: Callable[[], str], obey: Callable[[str], None]) -> None:
        self.learn, self.obey = learn, obey
        self._stored: dict[int, str] = {}

    def save(self, place: int) -> None:
        """`*SAV`."""
        self._stored[place] = self.learn()

    def recall(self, place: int) -> None:
        """`*RCL`; -200 from a location that nothing was saved in."""
        if place not in self._stored:
            raise ScpiError(-200, f"no setup in location {place}")
        self.obey(self._stored[place])

    def delete(self, *places: int) -> None:
        """`DELEte:SETUp`."""
        for place in places:
            self._stored.pop(place, None)


SETUP_COMMANDS = (
    *(Group(f"{header}?") for header in ("ACQuire", "AUXout", "CH#", "DATa", "FASTAcq", "MATH#")),
    *(Group(f"HORizontal{header}?") for header in ("", ":MAIn", ":FASTframe")),
    *(Group(f"MEASUrement{header}?") for header in ("", ":IMMed", ":MEAS#")),
    *(
        Group(f"MEASUrement:{measurement}:{header}?")
        for measurement in ("IMMed", "MEAS#")
        for header in ("DELay", "REFLevel")
    ),
    Group("REF#:LABel?"),
    Group("SELect?"),
    *(Group(f"TRIGger{header}?") for header in ("", ":A", ":A:EDGE", ":A:HOLDoff")),
    Query("SET?", "setups.learn", labelled=True),
    Query("*LRN?", "setups.learn", labelled=True),
    Action("*SAV", "setups.save", PLACE),
    Action("*RCL", "setups.recall", PLACE),
)


def _nodes(header: str) -> list[str]:
    return header.replace("[", "").replace("]", "").split(":")


def _suffixed(setting: Setting, given: int) -> str:
    """The header up to the first suffix behind the given ones, without it; "" if there is none."""
    parts = ":".join(_nodes(setting.header)).split("#")
    return "#".join(parts[: given + 1]) if len(parts) > given + 1 else ""
