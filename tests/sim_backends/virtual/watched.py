"""A world that notes what the instruments do to it, and how tests talk to an instrument."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sim_backends.optics.mirrors import on_counts
from sim_backends.parameters import Parameters
from sim_backends.scpi.messages import Message, MessageReader
from sim_backends.virtual import VirtualInstrument
from sim_backends.world.signals import Acquisition, Emission, Playback, Projection, Record
from sim_backends.world.world import World

Ask = Callable[[VirtualInstrument, str | bytes], bytes]
Read = Callable[[str | bytes], list[Message]]
Mirrors = NDArray[np.uint8]

SMALL = Parameters(light_path="direct", chip_modes=50)
"""No fibre and few resonances: quickly made."""


class Watched(World):
    """Notes light, waveforms, triggers, pictures and records; `last` and `picture` are those of now."""

    def __init__(self, parameters: Parameters = SMALL) -> None:
        super().__init__(parameters)
        self.light: Emission | None = None
        self.lit_from_s = 0.0
        self.played: list[Playback | None] = []
        self.triggers = 0
        self.level = (0.0, True)
        self.shown: list[Mirrors | Projection | None] = []
        self.records: list[tuple[Acquisition, NDArray[np.float64]]] = []

    @property
    def last(self) -> Playback | None:
        return self.played[-1] if self.played else None

    @property
    def picture(self) -> NDArray[np.uint16] | None:
        """Mirrors on in every superpixel, (784,); None: they float."""
        last = self.shown[-1]
        if not isinstance(last, Projection):
            return None if last is None else on_counts(last)
        number = self.pictures_shown() - 1
        return last.counts[number % len(last.counts)] if number >= 0 else None

    def emit(self, emission: Emission | None, *, lit_from_s: float = 0.0) -> None:
        self.light, self.lit_from_s = emission, lit_from_s
        super().emit(emission, lit_from_s=lit_from_s)

    def play(self, playback: Playback | None) -> None:
        self.played.append(playback)
        super().play(playback)

    def trigger_awg(self) -> None:
        self.triggers += 1
        super().trigger_awg()

    def awg_trigger_level(self, level_v: float, *, rising: bool) -> None:
        self.level = level_v, rising
        super().awg_trigger_level(level_v, rising=rising)

    def show(self, mirrors: Mirrors | None) -> None:
        self.shown.append(mirrors)
        super().show(mirrors)

    def project(self, projection: Projection) -> None:
        self.shown.append(projection)
        super().project(projection)

    def record(
        self,
        acquisition: Acquisition,
        trigger_times: NDArray[np.float64],
        *,
        setting: bytes = b"",
        whole: Acquisition | None = None,
    ) -> Record:
        self.records.append((acquisition, trigger_times))
        return super().record(acquisition, trigger_times, setting=setting, whole=whole)


def messages(text: str | bytes) -> list[Message]:
    """Messages as a connection would deliver them; the last one ends with the text."""
    stream = (text.encode("latin-1") if isinstance(text, str) else text) + b"\n"
    reader, found = MessageReader(), []
    while stream:
        room = reader.buffer()
        count = min(len(room), len(stream))
        room[:count] = stream[:count]
        stream = stream[count:]
        found += reader.received(count)
    return found
