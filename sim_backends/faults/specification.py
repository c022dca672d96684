"""Faults as a person writes them: `INSTRUMENT:FAULT[@MESSAGE][,nth=N][,times=N][,byte=N]`.

`scope:no-reply@CURVe?,nth=3` is the third `CURVe?` that the oscilloscope hears; it stays unanswered.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

from sim_backends.faults import distortions
from sim_backends.faults.bench import Befalling
from sim_backends.faults.catalogue import BEFALL, WIRE, Fault, Moment

GRAMMAR = "INSTRUMENT:FAULT[@MESSAGE][,nth=N][,times=N][,byte=N]"
LARGEST = 10**9

_WRITTEN = re.compile(r"(?P<role>[^:@,]*):(?P<name>[^@,]*)(@(?P<message>[^,]*))?(?P<numbers>(,[^,]*)*)")
_NUMBER = re.compile(r"(nth|times|byte)=([0-9]{1,10})")


class FaultError(ValueError):
    """No such fault: one line that says what is known."""


class Listed(NamedTuple):
    """A fault as it is listed: its name, what it does, whom it may befall, and at which message if none is named."""

    name: str
    told: str
    instruments: tuple[str, ...]
    at: str


def read_fault(text: str) -> Befalling:
    """The fault that `text` asks for.

    Raises:
        FaultError: there is none.
    """
    written = _WRITTEN.fullmatch(text)
    if written is None:
        raise FaultError(f"{text!r}: write {GRAMMAR}, such as scope:no-reply@CURVe?,nth=3")
    role, name = written["role"], written["name"]
    if role not in BEFALL:
        raise FaultError(f"{text!r}: no instrument {role!r}: one of {', '.join(BEFALL)}")
    known = _known(role)
    if name not in known:
        raise FaultError(f"{text!r}: no fault {name!r} of {role}: one of {', '.join(known)}")
    fault, moment = known[name]
    numbers = _numbers(text, written["numbers"])
    if moment.count == 0 and (written["message"] is not None or numbers):
        raise FaultError(f"{text!r}: {name} comes before any message: leave out what follows it")
    if "byte" in numbers:
        if fault is not WIRE["lost inside"]:
            raise FaultError(f"{text!r}: byte= says where a reply breaks off: only with lost-inside")
        fault = replace(fault, reply=distortions.ending_after(numbers["byte"]))
    if "times" in numbers and fault.lasting:
        raise FaultError(f"{text!r}: {name} lasts from its message on: leave out times=")
    header = moment.header if written["message"] is None else written["message"].strip().lstrip(":")
    return Befalling(
        role,
        fault,
        moment if moment.count == 0 else Moment(header, numbers.get("nth", 1), numbers.get("times", 1)),
    )


def listed() -> list[Listed]:
    """Every fault there is; one that is the same for several instruments once."""
    found: dict[tuple[str, str, str], list[str]] = {}
    for role in BEFALL:
        for name, (fault, moment) in _known(role).items():
            at = "before any message" if moment.count == 0 else moment.header or "first message"
            found.setdefault((name, fault.told, at), []).append(role)
    return [Listed(name, told, tuple(roles), at) for (name, told, at), roles in found.items()]


def _known(role: str) -> Mapping[str, tuple[Fault, Moment]]:
    return {_spelt(name): (fault, moment) for faults, moment in BEFALL[role] for name, fault in faults.items()}


def _spelt(name: str) -> str:
    """A fault's name as one word: small letters, hyphens."""
    return re.sub(r"[^a-z0-9]+", "-", name.lower().replace("'", "")).strip("-")


def _numbers(text: str, written: str) -> dict[str, int]:
    numbers = {}
    for item in filter(None, written.split(",")):
        found = _NUMBER.fullmatch(item.strip())
        if found is None or int(found[2]) > LARGEST:
            raise FaultError(f"{text!r}: {item!r} is none of nth=N, times=N, byte=N")
        if int(found[2]) == 0 and found[1] != "byte":
            raise FaultError(f"{text!r}: {item!r}: messages are counted from 1")
        numbers[found[1]] = int(found[2])
    return numbers
