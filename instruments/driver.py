"""What a driver declares before it is opened: its section of the station file, and how it is found and opened.

Each driver declares one `Driver`; the entry points of the group `labctl.instruments` name these objects, and a station
file names the entry points.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from instruments.interfaces import Instrument
from instruments.sections import InstrumentSection
from instruments.transcripts import Transcript
from instruments.values import Range

SectionT = TypeVar("SectionT", bound=InstrumentSection)

Ask = Callable[[str], str]
"""Shows a request to the operator and returns what was typed."""


@dataclass(frozen=True)
class Opening:
    """What a driver gets besides its section of the station file.

    address: where the instrument is, the section's own or that of a simulated or replayed one. transcript: logs every
    message. ask: asks the operator. attended: whether somebody is at the bench.
    """

    address: str
    transcript: Transcript
    ask: Ask
    attended: bool


@dataclass(frozen=True)
class LaserRanges:
    """Where a laser can be set: wavelength (nm) and optical power (dBm).

    source: where the ranges are stated, as in "the laser of ...". key: which key of its section decides them, if one
    does.
    """

    wavelength: Range
    power: Range
    source: str
    key: str = ""


@dataclass(frozen=True)
class Driver(Generic[SectionT]):
    """A driver as data.

    Attributes:
        section: The model of its section of the station file: that of its role, or one derived from it with more keys.
        open: Makes the instrument of a section and an `Opening`; sends nothing. Raises `NotConfigured` where the
            operator has to supply something first.
        identity: What maker and model of `*IDN?` read like; None where none of its instruments answer that.
        sent_anew: The names in `settings()`, as patterns of file names, that every run sends before its first record:
            a run goes on whatever their values were before it.
        by_hand: Whether a person sets the instrument: it has no address then.
        ranges: Where the laser of a section can be set, found out without opening it; None where that is not known.
            Raises `NotConfigured` where a file that states them cannot be read.
    """

    section: type[SectionT]
    open: Callable[[SectionT, Opening], Instrument]
    identity: re.Pattern[str] | None = None
    sent_anew: tuple[str, ...] = ()
    by_hand: bool = False
    ranges: Callable[[SectionT], LaserRanges | None] = lambda _section: None

    @property
    def role(self) -> str:
        """Which instrument of the bench it drives: one of `interfaces.INTERFACES`, or another with its own name."""
        return self.section.role
