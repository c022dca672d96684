"""The waveform list of the virtual AWG, its commands, and what the DAC makes of a waveform.

Source: instrument facts 1.4.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import Real, block, boolean, integer, keyword, optional, quoted, quoted_or_all, real
from sim_backends.scpi.commands import Action, ItemSetting, Query, definite_block
from sim_backends.scpi.messages import Chunk
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a import edits
from sim_backends.virtual.awg70002a.wfmx import WaveformFile
from sim_backends.world.world import VirtualClock

SHORTEST = 2400  # points that can be assigned to a channel
LONGEST = 2_000_000_000
RATES = (1.49e3, 25e9)  # S/s
AMPLITUDES_V = (0.25, 0.5)  # Vpp, direct path; 0.125 V is claimed elsewhere
LARGEST_FACTOR = 1e6  # recalled
OFFSETS_V = (-0.4, 0.8)  # behind the external DC amplifier

MARKER_1 = 0x40  # bit 6 of a marker byte; marker 2 is bit 7
SWITCHED_ON = datetime(2024, 1, 1)
NOT_A_NUMBER = 9.91e37  # SCPI-99, volume 1, 7.2.1.5


class Recommended(Real):
    """A recommended setting; one that was never made (nan) is reported as SCPI's 9.91E37."""

    def format(self, value: float, *, verbose: bool) -> str:
        """NR3."""
        return super().format(NOT_A_NUMBER if np.isnan(value) else value, verbose=verbose)


RECOMMENDED = {
    "SRATe": ("sample_rate", Recommended(minimum=RATES[0], maximum=RATES[1])),
    "AMPLitude": ("amplitude_v", Recommended(minimum=AMPLITUDES_V[0], maximum=AMPLITUDES_V[1])),
    "OFFSet": ("offset_v", Recommended(minimum=OFFSETS_V[0], maximum=OFFSETS_V[1])),
}

_SPAN = (optional(integer()), optional(integer()))

WAVEFORM_COMMANDS = (
    Query("WLISt:SIZE?", "waveforms.__len__"),
    Query("WLISt:NAME?", "waveforms.name_at", integer(1)),
    Query("WLISt:LIST?", "waveforms.names"),
    Query("WLISt:LAST?", "waveforms.last"),
    Action(
        "WLISt:WAVeform:NEW",
        "waveforms.new",
        quoted,
        integer(1, LONGEST),
        *map(optional, (keyword("REAL", "IQ"), boolean)),
    ),
    Action("WLISt:WAVeform:DELete", "waveforms.delete", quoted_or_all),
    Query("WLISt:WAVeform:LENGth?", "waveforms.length", quoted),
    Query("WLISt:WAVeform:LMINimum?", "waveforms.shortest"),
    Query("WLISt:WAVeform:LMAXimum?", "waveforms.longest"),
    Query("WLISt:WAVeform:GRANularity?", "waveforms.granularity"),
    Query("WLISt:WAVeform:TYPE?", "waveforms.kind", quoted),
    ItemSetting("WLISt:WAVeform:SFORmat", "waveforms", "signal_format", keyword("REAL", "I", "Q", "IQ"), quoted),
    Query("WLISt:WAVeform:TSTamp?", "waveforms.changed", quoted),
    Action("WLISt:WAVeform:DATA[:I]", "waveforms.write_samples", quoted, *_SPAN, block("<f4")),
    Query("WLISt:WAVeform:DATA[:I]?", "waveforms.read_samples", quoted, *_SPAN),
    Action("WLISt:WAVeform:DATA:Q", "waveforms.write_quadrature", quoted, *_SPAN, block("<f4")),
    Query("WLISt:WAVeform:DATA:Q?", "waveforms.read_quadrature", quoted, *_SPAN),
    Action("WLISt:WAVeform:MARKer:DATA", "waveforms.write_markers", quoted, *_SPAN, block("u1")),
    Query("WLISt:WAVeform:MARKer:DATA?", "waveforms.read_markers", quoted, *_SPAN),
    *(
        ItemSetting(f"WLISt:WAVeform:{node}", "waveforms", name, kind, quoted)
        for node, (name, kind) in RECOMMENDED.items()
    ),
    Action("WLISt:WAVeform:NORMalize", "waveforms.normalise", quoted, keyword("FSCale", "ZREFerence")),
    Action("WLISt:WAVeform:SHIFt", "waveforms.shift", quoted, real(-360, 360)),
    Action("WLISt:WAVeform:ROTate:DEGRees", "waveforms.shift", quoted, real(-360, 360)),
    Action("WLISt:WAVeform:AOFFset", "waveforms.move", quoted, real(-2, 2)),
    Action("WLISt:WAVeform:SCALe", "waveforms.scale", quoted, real(-LARGEST_FACTOR, LARGEST_FACTOR)),
    Action("WLISt:WAVeform:REVerse", "waveforms.reverse", quoted),
    Action("WLISt:WAVeform:ROTate:POINts", "waveforms.rotate", quoted, integer(-LONGEST, LONGEST)),
    Action("WLISt:WAVeform:INVert", "waveforms.invert", quoted),
    Action("WLISt:WAVeform:RESample", "waveforms.resample", quoted, integer(1, LONGEST)),
)


def calendar(virtual_s: float) -> datetime:
    """The instrument's date at a virtual time."""
    return SWITCHED_ON + timedelta(seconds=virtual_s)


@dataclass(eq=False)
class Waveform:
    """One entry of the list.

    Attributes:
        samples: (n,) float32, as uploaded; the DAC clips to -1..1. Of an IQ waveform the I component.
        markers: (n,) marker bytes.
        clock: virtual time, which dates its changes.
        quadrature: (n,) float32, the Q component of an IQ waveform, otherwise None.
        sample_rate: recommended rate (S/s); nan for none, as the two below.
        amplitude_v: recommended amplitude (Vpp).
        offset_v: recommended offset (V).
        version: counts changes.
        changed_s: virtual time of the last change, or of the creation.
    """

    name: str
    samples: NDArray[np.float32]
    markers: NDArray[np.uint8]
    clock: VirtualClock
    quadrature: NDArray[np.float32] | None = None
    sample_rate: float = nan
    amplitude_v: float = nan
    offset_v: float = nan
    signal_format: str = field(default="REAL")
    version: int = 0
    changed_s: float = field(init=False)

    def __post_init__(self) -> None:
        self.changed_s = self.clock.now

    @property
    def length(self) -> int:
        """Points."""
        return self.samples.size

    def modified(self) -> None:
        """Count a change, and date it."""
        self.version += 1
        self.changed_s = self.clock.now

    def component(self, name: str) -> NDArray[np.float32]:
        """The samples of I (or of a real waveform), or of Q; -221 where there is no Q."""
        if name != "Q":
            return self.samples
        if self.quadrature is None:
            raise ScpiError(-221, f"{self.name} is real")
        return self.quadrature

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
        self.modified()

    def replace(self, samples: NDArray[np.float32], markers: NDArray[np.uint8] | None = None) -> None:
        """Put other samples (and markers) in the place of the present ones."""
        self.samples = samples
        self.markers = self.markers if markers is None else markers
        self.modified()

    def converted(self, bits: int, component: str = "I") -> NDArray[np.float32]:
        """What a DAC of `bits` puts out, -1..1: clipped, on 2^bits - 1 levels symmetrical about zero, +1 full scale."""
        return converted(self.component(component), bits)


def converted(samples: NDArray[np.float32], bits: int) -> NDArray[np.float32]:
    """What a DAC of `bits` puts out, -1..1: clipped, on 2^bits - 1 levels symmetrical about zero, +1 full scale."""
    top = 2 ** (bits - 1) - 1
    clipped = np.clip(np.nan_to_num(samples), -1.0, 1.0)
    return np.asarray(np.rint(clipped * top) / top, np.float32)


class WaveformList:
    """The waveforms in the order of their creation; names are unique."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._waveforms: dict[str, Waveform] = {}
        self._changes = 0

    def __len__(self) -> int:
        return len(self._waveforms)

    def __contains__(self, waveform: object) -> bool:
        return isinstance(waveform, Waveform) and self._waveforms.get(waveform.name) is waveform

    def __iter__(self) -> Iterator[str]:
        return iter(self._waveforms)

    def __getitem__(self, name: str) -> Waveform:
        """The waveform of that name; -224 if there is none."""
        try:
            return self._waveforms[name]
        except KeyError:
            raise ScpiError(-224, f"no waveform {name}") from None

    def find(self, name: str) -> Waveform | None:
        """The waveform of that name, None if there is none."""
        return self._waveforms.get(name)

    @property
    def version(self) -> tuple[int, int]:
        """Differs whenever a waveform or the list has changed."""
        return self._changes, sum(waveform.version for waveform in self._waveforms.values())

    def new(self, name: str, length: int, form: str | None, saveable: bool | None) -> None:
        """Add a waveform of zeros; -224 if the name is taken or empty, -225 if memory does not suffice."""
        if name in self._waveforms or not name:
            raise ScpiError(-224, f"waveform {name} exists" if name else "empty name")
        try:
            samples, markers = np.zeros(length, np.float32), np.zeros(length, np.uint8)
            quadrature = np.zeros(length, np.float32) if form == "IQ" else None
        except MemoryError:
            raise ScpiError(-225, f"{length} points") from None
        waveform = Waveform(name, samples, markers, self._clock, quadrature, signal_format=form or "REAL")
        self._waveforms[name] = waveform
        self._changes += 1

    def put(self, name: str, file: WaveformFile) -> None:
        """Add the waveform of a file, or put it in the place of the one of that name; -224 for an empty name."""
        if not name:
            raise ScpiError(-224, "empty name")
        waveform = self._waveforms.setdefault(name, Waveform(name, file.samples, file.markers, self._clock))
        waveform.quadrature = None
        waveform.sample_rate, waveform.amplitude_v = file.sample_rate, file.amplitude_v
        waveform.offset_v = file.offset_v
        waveform.replace(file.samples, file.markers)
        self._changes += 1

    def delete(self, name: str) -> None:
        """Take one waveform, or ALL, off the list."""
        if name == "ALL":
            self._waveforms.clear()
        else:
            del self._waveforms[self[name].name]
        self._changes += 1

    # --- upload and read-back

    def write_samples(self, name: str, start: int | None, size: int | None, data: NDArray[np.float32]) -> None:
        """Upload samples: unknown name -224, wrong length -161, beyond the end -222."""
        waveform = self[name]
        waveform.write(waveform.samples, start, size, data)

    def write_quadrature(self, name: str, start: int | None, size: int | None, data: NDArray[np.float32]) -> None:
        """Upload the Q component; -221 for a real waveform."""
        waveform = self[name]
        waveform.write(waveform.component("Q"), start, size, data)

    def write_markers(self, name: str, start: int | None, size: int | None, data: NDArray[np.uint8]) -> None:
        """Upload marker bytes."""
        waveform = self[name]
        waveform.write(waveform.markers, start, size, data)

    def read_samples(self, name: str, start: int | None, size: int | None) -> list[Chunk]:
        """Samples as a block of little-endian float32."""
        waveform = self[name]
        return definite_block(waveform.samples[waveform.span(start, size)].astype("<f4", copy=False).data.cast("B"))

    def read_quadrature(self, name: str, start: int | None, size: int | None) -> list[Chunk]:
        """The Q component as a block of little-endian float32; -221 for a real waveform."""
        waveform = self[name]
        samples = waveform.component("Q")[waveform.span(start, size)]
        return definite_block(samples.astype("<f4", copy=False).data.cast("B"))

    def read_markers(self, name: str, start: int | None, size: int | None) -> list[Chunk]:
        """Marker bytes as a block."""
        waveform = self[name]
        return definite_block(waveform.markers[waveform.span(start, size)].data)

    # --- editing

    def normalise(self, name: str, reference: str) -> None:
        """Stretch a waveform to full scale, its range (FSCale) or about its zero (ZREFerence)."""
        waveform = self[name]
        waveform.replace(edits.normalised(waveform.samples, keep_zero=reference == "ZREFerence"))

    def rotate(self, name: str, points: int) -> None:
        """Move the last `points` samples and markers to the front."""
        waveform = self[name]
        if waveform.quadrature is not None:
            waveform.quadrature = np.roll(waveform.quadrature, points)
        waveform.replace(np.roll(waveform.samples, points), np.roll(waveform.markers, points))

    def shift(self, name: str, degrees: float) -> None:
        """The same, 360 degrees being the whole waveform."""
        self.rotate(name, edits.points_of(degrees, self[name].length))

    def invert(self, name: str) -> None:
        """Turn a waveform upside down; its offset stays."""
        waveform = self[name]
        waveform.replace(edits.inverted(waveform.samples))

    def move(self, name: str, factor: float) -> None:
        """Add an offset, a part of the full scale."""
        waveform = self[name]
        waveform.replace(edits.offset(waveform.samples, factor))

    def scale(self, name: str, factor: float) -> None:
        """Multiply the samples, both components of an IQ waveform."""
        waveform = self[name]
        if waveform.quadrature is not None:
            waveform.quadrature = edits.scaled(waveform.quadrature, factor)
        waveform.replace(edits.scaled(waveform.samples, factor))

    def reverse(self, name: str) -> None:
        """Turn a waveform's order around, markers too."""
        waveform = self[name]
        if waveform.quadrature is not None:
            waveform.quadrature = waveform.quadrature[::-1].copy()
        waveform.replace(waveform.samples[::-1].copy(), waveform.markers[::-1].copy())

    def resample(self, name: str, size: int) -> None:
        """Put a waveform on `size` points; -225 if memory does not suffice."""
        waveform = self[name]
        try:
            if waveform.quadrature is not None:
                waveform.quadrature = edits.resampled(waveform.quadrature, size)
            samples, markers = (
                edits.resampled(waveform.samples, size),
                edits.nearest(waveform.markers, size),
            )
        except MemoryError:
            raise ScpiError(-225, f"{size} points") from None
        waveform.replace(samples, markers)

    # --- queries

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
        """REAL or IQ."""
        return "REAL" if self[name].quadrature is None else "IQ"

    def changed(self, name: str) -> str:
        """Time stamp of a waveform: when it was created or last changed."""
        return f'"{calendar(self[name].changed_s):%Y/%m/%d %H:%M:%S}"'

    def shortest(self) -> int:
        """Points a waveform must have to be assigned."""
        return SHORTEST

    def longest(self) -> int:
        """Points a waveform can have."""
        return LONGEST

    def granularity(self) -> int:
        """Any number of points will do."""
        return 1
