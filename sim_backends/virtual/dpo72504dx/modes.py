"""Acquisition modes of the virtual oscilloscope: what becomes of the samples behind each trigger.

Source: instrument facts 2.5 and 2.8. High resolution and peak detection work on samples of the base rate and exist
below it only. An envelope holds lowest and highest code in turn: each pair of points covers two intervals.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import boolean, integer, keyword, number_or_word
from sim_backends.scpi.commands import Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.dpo72504dx.digitiser import digitised
from sim_backends.virtual.dpo72504dx.vertical import Vertical
from sim_backends.world.signals import Acquisition
from sim_backends.world.world import World

BASE_RATE = 6.25e9
OVERSAMPLED_AT_MOST = 64  # bounds the work; the real digitiser never slows down
ENVELOPES_AT_MOST = 2000

Codes = NDArray[np.int8] | NDArray[np.int16]
NO_CODES = np.empty((0, 0), np.int8)

MODE_COMMANDS = (
    Setting("ACQuire:STOPAfter", "mode.stop_after", keyword("RUNSTop", "SEQuence")),
    Setting("ACQuire:MODe", "mode.chosen", keyword("SAMple", "PEAKdetect", "HIRes", "AVErage", "WFMDB", "ENVelope")),
    Setting("ACQuire:MODe:ACTUal?", "actual_mode", keyword("SAMple", "PEAKdetect", "HIRes", "AVErage", "ENVelope")),
    Setting("ACQuire:NUMAVg", "mode.averages", integer(2, 10240)),
    Setting("ACQuire:NUMEnv", "mode.envelopes", number_or_word(1, 2**31 - 1, "INFInite")),
    Setting("ACQuire:SAMPlingmode", "mode.sampling", keyword("RT", "ET", "IT")),
    Setting("ACQuire:INTERPEightbit", "mode.interpolation", keyword("AUTO", "ON", "OFF")),
    Setting("ACQuire:SYNcsamples", "mode.synchronous", boolean),
    Setting("ACQuire:ENHANCEDEnob", "mode.enhanced_enob", keyword("OFF", "AUTO")),
)


@dataclass
class Mode:
    """How the acquisition system is set."""

    stop_after: str = "RUNSTop"
    averages: int = 16
    interpolation: str = "AUTO"
    synchronous: bool = False
    enhanced_enob: str = "OFF"
    _chosen: str = "SAMple"
    _sampling: str = "RT"
    _envelopes: int | str = 10

    @property
    def chosen(self) -> str:
        """`ACQuire:MODe`; -221 for the waveform database, whose pixel maps are not simulated."""
        return self._chosen

    @chosen.setter
    def chosen(self, word: str) -> None:
        if word == "WFMDB":
            raise ScpiError(-221, "waveform databases are not simulated")
        self._chosen = word

    @property
    def sampling(self) -> str:
        """RT, or IT, which at the rates there are interpolates nothing; -221 for equivalent time."""
        return self._sampling

    @sampling.setter
    def sampling(self, word: str) -> None:
        if word == "ET":
            raise ScpiError(-221, "equivalent-time sampling is not simulated")
        self._sampling = word

    @property
    def envelopes(self) -> int | str:
        """Acquisitions of an envelope; more than 2000 are infinitely many, of which 2000 are taken here."""
        return self._envelopes

    @envelopes.setter
    def envelopes(self, count: int | str) -> None:
        self._envelopes = count if isinstance(count, int) and count <= ENVELOPES_AT_MOST else "INFInite"

    def actual(self, sample_rate: float, *, frames: bool) -> str:
        """The mode really used: neither FastFrame nor the highest rates leave the choice."""
        if self._chosen in ("HIRes", "PEAKdetect"):
            return self._chosen if sample_rate < BASE_RATE else "SAMple"
        return "SAMple" if frames else self._chosen

    def triggers(self, actual: str) -> int:
        """Triggers of one acquisition."""
        if actual == "AVErage":
            return self.averages
        if actual == "ENVelope":
            return self._envelopes if isinstance(self._envelopes, int) else ENVELOPES_AT_MOST
        return 1


@dataclass(frozen=True)
class Plan:
    """One acquisition as its settings were when it began.

    Attributes:
        acquisition: The samples that clients get.
        trigger_sample: Index of the sample at the trigger.
        verticals: One a channel.
        mode: The mode really used.
        triggers: How many the acquisition wants.
        aligned: Samples are interpolated to the trigger, so that its sub-sample time is 0.
    """

    acquisition: Acquisition
    trigger_sample: int
    verticals: tuple[Vertical, ...]
    mode: str
    triggers: int
    aligned: bool = False

    @property
    def enveloped(self) -> bool:
        """Whether points are lowest and highest codes in turn."""
        return self.mode in ("PEAKdetect", "ENVelope")

    @property
    def oversampling(self) -> int:
        """Samples in one of the acquisition's intervals."""
        if self.mode not in ("HIRes", "PEAKdetect"):
            return 1
        return min(round(BASE_RATE / self.acquisition.sample_rate), OVERSAMPLED_AT_MOST)

    @property
    def sampled(self) -> Acquisition:
        """What the digitiser samples: every interval's samples lie around the point that they become."""
        factor, points = self.oversampling, self.acquisition
        if factor == 1:
            return points
        rate = points.sample_rate * factor
        start_s = points.start_s - (factor - 1) / 2 / rate
        return replace(points, sample_rate=rate, samples=points.samples * factor, start_s=start_s)


@dataclass(eq=False)
class Progress:
    """An acquisition under way: what has been recorded of it."""

    plan: Plan
    times: list[NDArray[np.float64]] = field(default_factory=list)
    offsets: list[NDArray[np.float64]] = field(default_factory=list)
    _frames: list[Codes] = field(default_factory=list)
    _low: NDArray[np.int8] | None = None
    _high: NDArray[np.int8] | None = None
    _total: NDArray[np.int64] | None = None
    count: int = 0

    @property
    def missing(self) -> int:
        """Triggers that are still wanted."""
        return self.plan.triggers - self.count

    def add(self, world: World, times: NDArray[np.float64]) -> None:
        """Record and digitise what follows `times`."""
        self.times.append(times)
        self.count += times.size
        if not self.plan.verticals:
            return
        for codes, offsets in digitised(world, self.plan.sampled, times, self.plan.verticals):
            aligned = _aligned(codes, offsets, self.plan.sampled.sample_rate) if self.plan.aligned else codes
            self.offsets.append(np.zeros_like(offsets) if self.plan.aligned else offsets)
            self._keep(aligned)

    def _keep(self, codes: NDArray[np.int8]) -> None:
        mode, points = self.plan.mode, self.plan.acquisition.samples
        if mode == "AVErage":
            total = codes.sum(axis=1, dtype=np.int64)
            self._total = total if self._total is None else self._total + total
        elif mode == "ENVelope":
            low, high = codes.min(axis=1), codes.max(axis=1)
            self._low = low if self._low is None else np.minimum(self._low, low)
            self._high = high if self._high is None else np.maximum(self._high, high)
        elif mode == "HIRes":
            blocks = codes.reshape(*codes.shape[:2], points, -1)
            self._frames.append(np.rint(256 * blocks.mean(axis=3)).astype(np.int16))
        elif mode == "PEAKdetect":
            blocks = codes.reshape(*codes.shape[:2], points, -1)
            self._frames.append(interleaved(blocks.min(axis=3), blocks.max(axis=3)))
        else:
            self._frames.append(codes)

    def codes(self) -> Codes:
        """(channels, frames, samples) of what there is; at least one trigger must have come."""
        if self._total is not None:
            mean: NDArray[np.int16] = np.rint(self._total * (256 / self.count)).astype(np.int16)
            return mean[:, None]
        if self._low is not None and self._high is not None:
            return interleaved(self._low, self._high)[:, None]
        if len(self._frames) > 1:  # one array from now on: an acquisition is read many times
            parts = [np.asarray(part) for part in self._frames]
            self._frames = [np.concatenate(parts, axis=1)]
        return self._frames[0]

    def trigger_times(self) -> NDArray[np.float64]:
        """(triggers,) s, virtual."""
        return np.concatenate(self.times)

    def trigger_offsets(self) -> NDArray[np.float64]:
        """(frames,) s: of each frame, or the mean of what became one frame."""
        offsets = np.concatenate(self.offsets)
        single = self._total is not None or self._low is not None
        return np.array([offsets.mean()]) if single else offsets


def interleaved(low: NDArray[np.int8], high: NDArray[np.int8]) -> NDArray[np.int8]:
    """Envelope points: the lowest code of two neighbouring intervals, then the highest; (..., n) of each and of both.

    The last of an odd number of points is the lowest code of its own interval.
    """
    points = low.copy()
    even = low.shape[-1] // 2 * 2
    points[..., 0:even:2] = np.minimum(low[..., 0:even:2], low[..., 1:even:2])
    points[..., 1:even:2] = np.maximum(high[..., 0:even:2], high[..., 1:even:2])
    return points


def summarised(codes: Codes, summary: str, *, fine: bool) -> Codes:
    """Frames (channels, frames, samples) with the last one replaced by the mean or the envelope of those before it.

    `fine` keeps the mean to 16 bits, and with it every frame.
    """
    before = codes[:, :-1]
    if summary == "NONe" or before.shape[1] == 0:
        return codes
    if summary == "ENVelope":
        last = interleaved(before.min(axis=1), before.max(axis=1))
    else:
        mean = before.mean(axis=1)
        if fine and codes.dtype == np.int8:
            codes = codes.astype(np.int16) << 8
            mean = mean * 256
        last = np.rint(mean)
    summed = codes.copy()
    summed[:, -1] = last
    return summed


def _aligned(codes: NDArray[np.int8], offsets: NDArray[np.float64], sample_rate: float) -> NDArray[np.int8]:
    """Codes (channels, triggers, samples) interpolated to where they would be without the triggers' offsets (s)."""
    if not offsets.any():
        return codes
    frequencies = np.fft.rfftfreq(codes.shape[-1], 1 / sample_rate)
    shift = np.exp(-2j * np.pi * np.multiply.outer(offsets, frequencies))
    shifted = np.fft.irfft(np.fft.rfft(codes, axis=-1) * shift, codes.shape[-1], axis=-1)
    return np.clip(np.rint(shifted), -128, 127).astype(np.int8)
