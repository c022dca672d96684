"""The sequence list of the virtual AWG and its commands.

Source: instrument facts 1.7. How many tracks there may be, and what an unset jump target reads as, is recalled.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import nan
from typing import Generic, TypeVar

from sim_backends.scpi.arguments import (
    integer,
    keyword,
    number_or_word,
    optional,
    quoted,
    quoted_or_all,
    quoted_or_bare,
)
from sim_backends.scpi.commands import Action, ItemSetting, Query
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.waveforms import RECOMMENDED, WaveformList

MOST_STEPS = 16383
MOST_REPEATS = 2**20
MOST_TRACKS = 8  # recalled

WAIT = keyword("ATRigger", "BTRigger", "ITRigger", "OFF")
TARGET = number_or_word(1, MOST_STEPS, "NEXT", "FIRSt", "LAST", "END")
REPEATS = number_or_word(1, MOST_REPEATS, "ONCE", "INFinite")
FLAG = keyword("NCHange", "HIGH", "LOW", "TOGGle", "PULSe")
FLAGS = ("AFLag", "BFLag", "CFLag", "DFLag")

_STEP = "SLISt:SEQuence:STEP#"
_NAME = quoted_or_bare  # clients name sequences without quotes, too

SEQUENCE_COMMANDS = (
    Query("SLISt:SIZE?", "sequences.__len__"),
    Query("SLISt:NAME?", "sequences.name_at", integer(1)),
    Action("SLISt:SEQuence:NEW", "sequences.new", _NAME, integer(1, MOST_STEPS), optional(integer(1, MOST_TRACKS))),
    Action("SLISt:SEQuence:DELete", "sequences.delete", quoted_or_all),
    Query("SLISt:SEQuence:LENGth?", "sequences.length", _NAME),
    Query("SLISt:SEQuence:TRACk?", "sequences.tracks", _NAME),
    Query("SLISt:SEQuence:TRACk:MAX?", "sequences.most_tracks"),
    Action(
        "SLISt:SEQuence:STEP:ADD",
        "sequences.add_steps",
        _NAME,
        integer(1, MOST_STEPS),
        optional(integer(1, MOST_STEPS)),
    ),
    Query("SLISt:SEQuence:STEP:MAX?", "sequences.most_steps"),
    Query("SLISt:SEQuence:STEP:RCOunt:MAX?", "sequences.most_repeats"),
    Action(_STEP + ":TASSet#:WAVeform", "sequences.assign_waveform", _NAME, quoted),
    Action(_STEP + ":TASSet:SEQuence", "sequences.assign_subsequence", _NAME, quoted),
    Query(_STEP + ":TASSet#?", "sequences.asset", _NAME),
    Query(_STEP + ":TASSet#:TYPE?", "sequences.asset_type", _NAME),
    ItemSetting(_STEP + ":WINPut", "sequences", "steps#.wait", WAIT, _NAME),
    ItemSetting(_STEP + ":RCOunt", "sequences", "steps#.repeats", REPEATS, _NAME),
    ItemSetting(_STEP + ":GOTO", "sequences", "steps#.goto", TARGET, _NAME),
    ItemSetting(_STEP + ":EJINput", "sequences", "steps#.jump_input", WAIT, _NAME),
    ItemSetting(_STEP + ":EJUMp", "sequences", "steps#.jump_to", TARGET, _NAME),
    *(
        ItemSetting(f"{_STEP}:TFLag#:{flag}", "sequences", f"steps#.flags#.{flag[0].lower()}", FLAG, _NAME)
        for flag in FLAGS
    ),
    ItemSetting("SLISt:SEQuence:EVENt:JTIMing", "sequences", "jump_timing", keyword("END", "IMMediate"), _NAME),
    *(
        ItemSetting(f"SLISt:SEQuence:{node}", "sequences", name, kind, _NAME)
        for node, (name, kind) in RECOMMENDED.items()
    ),
)

Entry = TypeVar("Entry")


class Counted(Generic[Entry]):
    """Entries counted from 1; -222 beyond the last."""

    def __init__(self, entries: Sequence[Entry], what: str) -> None:
        self._entries = entries
        self._what = what

    def __getitem__(self, number: int) -> Entry:
        if 1 <= number <= len(self._entries):
            return self._entries[number - 1]
        raise ScpiError(-222, f"{self._what} {number} of {len(self._entries)}")

    def __len__(self) -> int:
        return len(self._entries)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self._entries)


@dataclass
class Flags:
    """The flag outputs of one track at one step; nothing of them reaches the light."""

    a: str = "NCHange"
    b: str = "NCHange"
    c: str = "NCHange"
    d: str = "NCHange"


@dataclass
class Step:
    """One step: what it waits for, plays how often, and where it goes on.

    Attributes:
        assets: Names, one a track ("" for none); a sub-sequence has its name on every track.
        subsequence: Whether the assets are a sub-sequence.
    """

    assets: list[str]
    track_flags: list[Flags]
    subsequence: bool = False
    wait: str = "OFF"
    repeats: int | str = "ONCE"
    goto: int | str = "NEXT"
    jump_input: str = "OFF"
    jump_to: int | str = "NEXT"

    @property
    def flags(self) -> Counted[Flags]:
        """Flags by track."""
        return Counted(self.track_flags, "track")

    @property
    def times(self) -> int | None:
        """How often the step plays; None for ever."""
        if isinstance(self.repeats, int):
            return self.repeats
        return 1 if self.repeats == "ONCE" else None


def new_step(tracks: int) -> Step:
    """An empty step."""
    return Step([""] * tracks, [Flags() for _ in range(tracks)])


def target(word: int | str, step: int, steps: int) -> int | None:
    """The step (from 1) that `word` means at `step`; None for the end, `steps` + 1 behind the last step."""
    if isinstance(word, int):
        return word
    return {"NEXT": step + 1, "FIRSt": 1, "LAST": steps, "END": None}[word]


@dataclass(eq=False)
class SequenceEntry:
    """One sequence of the list; recommended settings are nan while there are none."""

    name: str
    tracks: int
    entries: list[Step]
    jump_timing: str = "END"
    sample_rate: float = nan
    amplitude_v: float = nan
    offset_v: float = nan
    version: int = 0

    @property
    def steps(self) -> Counted[Step]:
        """The steps, counted from 1."""
        return Counted(self.entries, "step")

    def modified(self) -> None:
        """Count a change."""
        self.version += 1

    def asset(self, step: int, track: int) -> str:
        """What is on a track of a step; -222 beyond either."""
        return Counted(self.steps[step].assets, "track")[track]

    def assign(self, step: int, track: int, name: str) -> None:
        """Put a waveform on a track of a step; -222 beyond either."""
        self.asset(step, track)
        entry = self.steps[step]
        if entry.subsequence:
            entry.assets = [""] * self.tracks
        entry.assets[track - 1], entry.subsequence = name, False
        self.modified()


class SequenceList:
    """The sequences in the order of their creation; names are unique. Their steps name entries of `waveforms`."""

    def __init__(self, waveforms: WaveformList) -> None:
        self._waveforms = waveforms
        self._sequences: dict[str, SequenceEntry] = {}
        self._changes = 0

    def __len__(self) -> int:
        return len(self._sequences)

    def __iter__(self) -> Iterator[str]:
        return iter(self._sequences)

    def __contains__(self, sequence: object) -> bool:
        return isinstance(sequence, SequenceEntry) and self._sequences.get(sequence.name) is sequence

    def __getitem__(self, name: str) -> SequenceEntry:
        """The sequence of that name; -224 if there is none."""
        try:
            return self._sequences[name]
        except KeyError:
            raise ScpiError(-224, f"no sequence {name}") from None

    def find(self, name: str) -> SequenceEntry | None:
        """The sequence of that name, None if there is none."""
        return self._sequences.get(name)

    @property
    def version(self) -> tuple[int, int]:
        """Differs whenever a sequence or the list has changed."""
        return self._changes, sum(sequence.version for sequence in self._sequences.values())

    def new(self, name: str, steps: int, tracks: int | None) -> None:
        """Add a sequence of empty steps; -224 if the name is taken or empty."""
        if name in self._sequences or not name:
            raise ScpiError(-224, f"sequence {name} exists" if name else "empty name")
        count = tracks or 1
        self.put(SequenceEntry(name, count, [new_step(count) for _ in range(steps)]))

    def put(self, sequence: SequenceEntry) -> None:
        """Add a sequence, or put it in the place of the one of that name."""
        sequence.modified()
        self._sequences[sequence.name] = sequence
        self._changes += 1

    def delete(self, name: str) -> None:
        """Take one sequence, or ALL, off the list."""
        if name == "ALL":
            self._sequences.clear()
        else:
            del self._sequences[self[name].name]
        self._changes += 1

    def add_steps(self, name: str, location: int, count: int | None) -> None:
        """Insert steps before `location`; one beyond the end is reached by further empty steps. -222 if too many."""
        sequence = self[name]
        gap = max(0, location - len(sequence.entries) - 1)
        added = gap + (count or 1)
        if len(sequence.entries) + added > MOST_STEPS:
            raise ScpiError(-222, f"{len(sequence.entries) + added} steps, {MOST_STEPS} are the most")
        at = min(location - 1, len(sequence.entries))
        sequence.entries[at:at] = [new_step(sequence.tracks) for _ in range(added)]
        sequence.modified()

    # --- assets of steps

    def assign_waveform(self, step: int, track: int, name: str, waveform: str) -> None:
        """Put a waveform on a track of a step: -224 unknown, -222 no such step or track."""
        self[name].assign(step, track, self._waveforms[waveform].name)

    def assign_subsequence(self, step: int, name: str, below: str) -> None:
        """Put a sub-sequence on a step: -224 unknown, -221 one that has sub-sequences, or the sequence itself."""
        sequence, inner = self[name], self[below]
        entry = sequence.steps[step]
        if inner is sequence or any(step.subsequence for step in inner.entries):
            raise ScpiError(-221, f"{below} cannot be a sub-sequence of {name}")
        entry.assets, entry.subsequence = [below] * sequence.tracks, True
        sequence.modified()

    def _asset(self, step: int, track: int, name: str) -> tuple[str, str]:
        """Name and type of an asset; one that was deleted is none."""
        asset = self[name].asset(step, track)
        if self[name].steps[step].subsequence:
            return (asset, "SEQ") if self.find(asset) else ("", "NONE")
        return (asset, "WAV") if self._waveforms.find(asset) else ("", "NONE")

    def asset(self, step: int, track: int, name: str) -> str:
        """Name of a step's waveform or sub-sequence, quoted."""
        return quoted.format(self._asset(step, track, name)[0], verbose=False)

    def asset_type(self, step: int, track: int, name: str) -> str:
        """WAV, SEQ or NONE."""
        return self._asset(step, track, name)[1]

    # --- queries

    def name_at(self, index: int) -> str:
        """Name of the sequence at `index`, counted from 1; -222 beyond the list."""
        return quoted.format(Counted(list(self._sequences), "sequence")[index], verbose=False)

    def length(self, name: str) -> int:
        """Steps of a sequence."""
        return len(self[name].entries)

    def tracks(self, name: str) -> int:
        """Tracks of a sequence."""
        return self[name].tracks

    def most_steps(self) -> int:
        """Steps a sequence can have."""
        return MOST_STEPS

    def most_tracks(self) -> int:
        """Tracks a sequence can have."""
        return MOST_TRACKS

    def most_repeats(self) -> int:
        """How often a step can be repeated."""
        return MOST_REPEATS
