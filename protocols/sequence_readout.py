"""Time series into the chip: a sequence of numbers modulates the light's phase, symbol by symbol; no DMD in the way."""

from collections.abc import Sequence
from contextlib import suppress
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveInt

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.values import Drive, Frames, Timebase
from protocols.base import (
    Events,
    Images,
    Judgement,
    Measurement,
    Part,
    Pass,
    PassStarted,
    ProtocolError,
    Record,
    Sequences,
    Shot,
    ShotKind,
)
from protocols.bursts import stretches
from protocols.first_light import first_light
from protocols.image_readout import balanced_order
from protocols.ranging import lock_ranges
from protocols.settings import Classes, Ports, Wavelengths, passes_for

DRIVE_RATE = 25e9
DRIVE_SAMPLES_PER_SYMBOL = 2
"""12.5 billion symbols a second."""
SYMBOL_S = DRIVE_SAMPLES_PER_SYMBOL / DRIVE_RATE

LONGEST_DELAY_S = 150e-9
"""From the trigger to the light: about what 30 m of fibre take."""
SILENCE_S = 50e-9
LEAD_SYMBOLS = round((LONGEST_DELAY_S + SILENCE_S) / SYMBOL_S)
"""Rest before the first symbol: the record is then certainly silent from the longest delay to the end of the lead."""
REST_SYMBOLS = 25
"""Rest of 2 ns behind every sequence: several times what the chip remembers."""
MARK_S = (LEAD_SYMBOLS + REST_SYMBOLS) * SYMBOL_S
"""Until the first sequence begins."""

ARRIVAL_TRIGGERS = 64
"""Whose mean shows when the light arrives, at least: in a single one noise hides its beginning for a sample."""
GUARD_SAMPLES = 1
"""Samples before the arrival at which frames begin: of what noise hides still, nearly all is in the last one."""
PROBES = 2
REAL_PASS_S = 8.0
"""Retuning, repatching, the upload, ranging and one averaged record of all sequences, on real instruments."""


class SequenceReadout(Measurement[Sequences]):
    """Play sequences through the modulator straight into the chip and record every port.

    The numbers are mapped to phases by the smallest and the largest of the set. All sequences follow each other in one
    waveform, with rests between them, behind a mark that shows when the light arrives; each is a shot of its own, whose
    frame starts one sample before the arrival of its first symbol: four samples a symbol of 80 ps, none of which holds
    light of the next one.

    `symbols` cuts longer sequences: a stretch of that length whose place is drawn by the seed.
    """

    name: ClassVar[str] = "sequence-readout"
    sample_rate: ClassVar[float] = 50e9
    projector: ClassVar[bool] = False
    takes: ClassVar[type[Images | Sequences]] = Sequences
    judgement: ClassVar[Judgement] = Judgement.EXPERIMENT

    dataset: str = "santa-fe"
    classes: Classes | None = None
    symbols: PositiveInt | None = None
    ports: Ports = (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 12, 13, 14)
    wavelengths: Wavelengths = (1550.0,)

    def shots(self, inputs: Sequences) -> Sequence[Shot]:
        """The sequences in a class-balanced random order."""
        order = balanced_order(inputs.labels, np.random.default_rng((self.seeds.order, 1)))
        return [
            Shot(
                place,
                ShotKind.SEQUENCE,
                int(inputs.indices[row]),
                int(inputs.labels[row]),
                int(inputs.groups[row]),
            )
            for place, row in enumerate(order)
        ]

    def passes(self, bench: Bench) -> tuple[Pass, ...]:
        """Every wavelength with every patching that the ports need."""
        return passes_for(bench, self.wavelengths, self.ports)

    def check(self, bench: Bench, inputs: Sequences) -> None:
        """The sequences must vary."""
        if np.ptp(inputs.values) == 0:
            raise ProtocolError(f"{self.dataset}: all values are equal: choose sequences that vary")

    def drive(self, bench: Bench, inputs: Sequences) -> Drive:
        """Lead, mark, then every sequence with its rest; two samples a symbol, rest at phase 0."""
        count, length = inputs.values.shape
        order = [inputs.places[shot.dataset_index] for shot in self.shots(inputs)]
        first = LEAD_SYMBOLS + REST_SYMBOLS
        symbols = np.zeros(first + count * _slot_symbols(inputs), np.float32)
        symbols[LEAD_SYMBOLS] = 1.0
        symbols[first:].reshape(count, -1)[:, :length] = _phases(inputs)[order]
        samples = np.repeat(symbols, DRIVE_SAMPLES_PER_SYMBOL)
        return Drive(self.name, samples, DRIVE_RATE, bench.levels.rf_amplitude_vpp)

    def sample_count(self, inputs: Sequences) -> int:
        """Four samples a symbol."""
        return int(inputs.values.shape[1]) * self._samples_per_symbol

    def duration_s(self, bench: Bench, shots: int) -> float:
        """Pass by pass: one record holds every sequence."""
        return len(self.passes(bench)) * REAL_PASS_S

    def acquire(self, bench: Bench, inputs: Sequences, parts: Sequence[Part]) -> Events:
        """Pass by pass one record of the whole waveform, cut into the frames of its sequences."""
        drive = self.drive(bench, inputs)
        first = self.passes(bench)[0]
        with bench.emitting(parts[0].pass_.wavelength_nm, first.patching):
            bench.load_drive(drive)
            bench.play_drive()
            begins = self._first_symbol_sample(bench, first)
            for part in parts:
                self._turn_to(bench, part.pass_, drive.period_s, self.averages)
                yield PassStarted(part.pass_, lock_ranges(bench, part.scalings, [bench.capture] * PROBES))
                record = bench.capture()
                self._require_no_earlier_light(record, begins, part.pass_)
                for places in stretches([shot.index for shot in part.shots], len(part.shots)):
                    yield Record(part.pass_, places.start, self._frames(record, begins, places, inputs))

    @property
    def _samples_per_symbol(self) -> int:
        return round(SYMBOL_S * self.sample_rate)

    def _turn_to(self, bench: Bench, pass_: Pass, duration_s: float, averages: int) -> None:
        """Records of the leg's ports that begin with the trigger."""
        bench.tune(pass_.wavelength_nm)
        bench.connect(pass_.patching)
        samples = round((LONGEST_DELAY_S + duration_s) * self.sample_rate)
        bench.configure(Timebase(self.sample_rate, samples), pass_.patching, averages)

    def _first_symbol_sample(self, bench: Bench, leg: Pass) -> int:
        """Where in a record the frame of the first sequence begins; the light of the mark shows it."""
        self._turn_to(bench, leg, MARK_S, max(ARRIVAL_TRIGGERS, self.averages))
        lock_ranges(bench, None, [bench.capture] * PROBES)
        return self._begins(bench.capture())

    def _begins(self, record: Frames) -> int:
        silent = slice(round(LONGEST_DELAY_S * self.sample_rate), LEAD_SYMBOLS * self._samples_per_symbol)
        marked = record.codes[0][:, : round((LONGEST_DELAY_S + MARK_S) * self.sample_rate)]
        return first_light(marked, silent=silent) - GUARD_SAMPLES + REST_SYMBOLS * self._samples_per_symbol

    def _require_no_earlier_light(self, record: Frames, begins: int, leg: Pass) -> None:
        """Noise hides an earlier mark, and never makes one; a later one does no harm.

        Raises:
            ProtocolError: the mark arrives earlier in this record, so that symbols would hold light of the next one.
        """
        with suppress(InstrumentError):  # ports that are all dark show no mark
            if (earlier := begins - self._begins(record)) > 0:
                ports = ", ".join(map(str, leg.patching.values()))
                raise ProtocolError(
                    f"light of ports {ports} arrives {earlier / self.sample_rate * 1e12:.0f} ps before that of the "
                    "ports measured first, so that symbols would hold light of the next one: name the port with the "
                    "shortest fibre first in ports"
                )

    def _frames(self, record: Frames, begins: int, places: range, inputs: Sequences) -> Frames:
        """The frames of the sequences at `places`, cut out of a record of all of them."""
        slot = _slot_symbols(inputs) * self._samples_per_symbol
        stop = begins + places.stop * slot
        codes = record.codes[0]
        slots = codes[:, begins + places.start * slot : stop].reshape(len(codes), len(places), slot)
        frames = slots[:, :, : self.sample_count(inputs)].swapaxes(0, 1)
        return Frames(
            frames.copy(),
            record.trigger_offset_s.repeat(len(places), axis=0),
            np.arange(len(places), dtype=np.float64) * (slot / self.sample_rate),
            record.clipped.repeat(len(places), axis=0),
        )


def _slot_symbols(inputs: Sequences) -> int:
    return int(inputs.values.shape[1]) + REST_SYMBOLS


def _phases(inputs: Sequences) -> NDArray[np.float32]:
    """The numbers (n, symbols) mapped to -1..1, the smallest and the largest of the set at the ends."""
    low, high = inputs.values.min(), inputs.values.max()
    phases: NDArray[np.float32] = (2 * (inputs.values - low) / (high - low) - 1).astype(np.float32)
    return phases
