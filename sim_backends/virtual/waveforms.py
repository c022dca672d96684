"""The waveform list of the virtual AWG, its commands, and what the DAC makes of a waveform.

Source: instrument facts 1.4.
"""

from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backends.clock import VirtualClock
from sim_backends.scpi.arguments import block, boolean, integer, keyword, optional, quoted, quoted_or_all
from sim_backends.scpi.commands import Action, Chunk, Query, definite_block
from sim_backends.scpi.status import ScpiError

SHORTEST = 2400  # points that can be assigned to a channel
LONGEST = 2_000_000_000

MARKER_1 = 0x40  # bit 6 of a marker byte; marker 2 is bit 7
SWITCHED_ON = datetime(2024, 1, 1)

_SPAN = (optional(integer()), optional(integer()))

WAVEFORM_COMMANDS = (
    Query("WLISt:SIZE?", "waveforms.__len__"),
    Query("WLISt:NAME?", "waveforms.name_at", integer(1)),
    Query("WLISt:LIST?", "waveforms.names"),
    Query("WLISt:LAST?", "waveforms.last"),
    Action(
        "WLISt:WAVeform:NEW", "waveforms.new", quoted, integer(1, LONGEST), *map(optional, (keyword("REAL"), boolean))
    ),
    Action("WLISt:WAVeform:DELete", "waveforms.delete", quoted_or_all),
    Query("WLISt:WAVeform:LENGth?", "waveforms.length", quoted),
    Query("WLISt:WAVeform:LMINimum?", "waveforms.shortest"),
    Query("WLISt:WAVeform:LMAXimum?", "waveforms.longest"),
    Query("WLISt:WAVeform:GRANularity?", "waveforms.granularity"),
    Query("WLISt:WAVeform:TYPE?", "waveforms.kind", quoted),
    Query("WLISt:WAVeform:SFORmat?", "waveforms.kind", quoted),
    Query("WLISt:WAVeform:TSTamp?", "waveforms.created", quoted),
    Action("WLISt:WAVeform:DATA[:I]", "waveforms.write_samples", quoted, *_SPAN, block("<f4")),
    Query("WLISt:WAVeform:DATA[:I]?", "waveforms.read_samples", quoted, *_SPAN),
    Action("WLISt:WAVeform:MARKer:DATA", "waveforms.write_markers", quoted, *_SPAN, block("u1")),
    Query("WLISt:WAVeform:MARKer:DATA?", "waveforms.read_markers", quoted, *_SPAN),
    Action("WLISt:WAVeform:NORMalize", "waveforms.normalise", quoted, keyword("FSCale", "ZREFerence")),
)


def calendar(virtual_s: float) -> datetime:
    """The instrument's date at a virtual time."""
    return SWITCHED_ON + timedelta(seconds=virtual_s)


@dataclass(eq=False)
class Waveform:
    """One entry of the list.

    Attributes:
        samples: (n,) float32, as uploaded; the DAC clips to -1..1.
        markers: (n,) marker bytes.
        created_s: virtual time of its creation.
        version: counts changes of the data.
    """

    name: str
    samples: NDArray[np.float32]
    markers: NDArray[np.uint8]
    created_s: float
    version: int = 0

    @property
    def length(self) -> int:
        """Points."""
        return self.samples.size

    def span(self, start: int | None, size: int | None) -> slice:
        """The points from `start` (0) on, `size` of them (all that follow); -222 beyond the end."""
        first = start or 0
        count = self.length - first if size is None else size
        if count < 0 or first + count > self.length:
            raise ScpiError(-222, f"{self.name} has {self.length} points")
        return slice(first, first + count)

    def write(self, into: NDArray[Any], start: int | None, size: int | None, data: NDArray[Any]) -> None:
        """Copy an uploaded block into `into` (samples or markers); -161 if its length is not the announced one."""
        if size is not None and size != data.size:
            raise ScpiError(-161, f"{size} points announced, {data.size} in the block")
        into[self.span(start, data.size)] = data
        self.version += 1

    def normalise(self, *, keep_zero: bool) -> None:
        """Stretch the samples to -1..1: by one factor with `keep_zero`, otherwise minimum to -1 and maximum to 1."""
        low, high = float(self.samples.min()), float(self.samples.max())
        centre = 0.0 if keep_zero else (low + high) / 2
        extent = max(abs(low), abs(high)) if keep_zero else (high - low) / 2
        if 0 < extent < np.inf:
            self.samples[:] = (self.samples - centre) / extent
            self.version += 1

    def converted(self, bits: int) -> NDArray[np.float32]:
        """What a DAC of `bits` puts out, -1..1: clipped, on 2^bits - 1 levels symmetrical about zero, +1 full scale."""
        top = 2 ** (bits - 1) - 1
        clipped = np.clip(np.nan_to_num(self.samples), -1.0, 1.0)
        return np.asarray(np.rint(clipped * top) / top, np.float32)


class WaveformList:
    """The waveforms in the order of their creation; names are unique."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._waveforms: dict[str, Waveform] = {}

    def __len__(self) -> int:
        return len(self._waveforms)

    def __contains__(self, waveform: object) -> bool:
        return isinstance(waveform, Waveform) and self._waveforms.get(waveform.name) is waveform

    def __getitem__(self, name: str) -> Waveform:
        """The waveform of that name; -224 if there is none."""
        try:
            return self._waveforms[name]
        except KeyError:
            raise ScpiError(-224, f"no waveform {name}") from None

    def new(self, name: str, length: int, form: str | None, saveable: bool | None) -> None:
        """Add a waveform of zeros; -224 if the name is taken or empty, -225 if memory does not suffice."""
        if name in self._waveforms or not name:
            raise ScpiError(-224, f"waveform {name} exists" if name else "empty name")
        try:
            samples, markers = np.zeros(length, np.float32), np.zeros(length, np.uint8)
        except MemoryError:
            raise ScpiError(-225, f"{length} points") from None
        self._waveforms[name] = Waveform(name, samples, markers, self._clock.now)

    def delete(self, name: str) -> None:
        """Take one waveform, or ALL, off the list."""
        if name == "ALL":
            self._waveforms.clear()
        else:
            del self._waveforms[self[name].name]

    def write_samples(self, name: str, start: int | None, size: int | None, data: NDArray[np.float32]) -> None:
        """Upload samples: unknown name -224, wrong length -161, beyond the end -222."""
        waveform = self[name]
        waveform.write(waveform.samples, start, size, data)

    def write_markers(self, name: str, start: int | None, size: int | None, data: NDArray[np.uint8]) -> None:
        """Upload marker bytes."""
        waveform = self[name]
        waveform.write(waveform.markers, start, size, data)

    def read_samples(self, name: str, start: int | None, size: int | None) -> list[Chunk]:
        """Samples as a block of little-endian float32."""
        waveform = self[name]
        return definite_block(waveform.samples[waveform.span(start, size)].astype("<f4", copy=False).data.cast("B"))

    def read_markers(self, name: str, start: int | None, size: int | None) -> list[Chunk]:
        """Marker bytes as a block."""
        waveform = self[name]
        return definite_block(waveform.markers[waveform.span(start, size)].data)

    def normalise(self, name: str, reference: str) -> None:
        """Stretch a waveform to full scale, its range (FSCale) or about its zero (ZREFerence)."""
        self[name].normalise(keep_zero=reference == "ZREFerence")

    def name_at(self, index: int) -> str:
        """Name of the waveform at `index`, counted from 1; -222 beyond the list."""
        if index > len(self):
            raise ScpiError(-222, f"the list has {len(self)} waveforms")
        return quoted.format(list(self._waveforms)[index - 1], verbose=False)

    def names(self) -> str:
        """All names in one string, separated by commas."""
        return quoted.format(",".join(self._waveforms), verbose=False)

    def last(self) -> str:
        """Name of the waveform added last; empty if there is none."""
        return quoted.format(next(reversed(self._waveforms), ""), verbose=False)

    def length(self, name: str) -> int:
        """Points of a waveform."""
        return self[name].length

    def kind(self, name: str) -> str:
        """REAL; complex waveforms cannot be made."""
        self[name]  # unknown: -224
        return "REAL"

    def created(self, name: str) -> str:
        """Time stamp of a waveform."""
        return f'"{calendar(self[name].created_s):%Y/%m/%d %H:%M:%S}"'

    def shortest(self) -> int:
        """Points a waveform must have to be assigned."""
        return SHORTEST

    def longest(self) -> int:
        """Points a waveform can have."""
        return LONGEST

    def granularity(self) -> int:
        """Any number of points will do."""
        return 1
