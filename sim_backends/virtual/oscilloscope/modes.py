"""Acquisition modes of the virtual oscilloscope: what becomes of the samples behind each trigger.

Source: instrument facts 2.5 and 2.8. High resolution and peak detection work on samples of the base rate and exist
below it only. An envelope holds lowest and highest code in turn: each pair of points covers two intervals. An average
is that of all triggers until there are ACQuire:NUMAVg of them; running on, it is exponential with that weight
(ACQuire:MODe: "a running exponential average"; MATH<x>:NUMAVg says from when on).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import boolean, integer, keyword
from sim_backends.scpi.commands import Setting
from sim_backends.scpi.status import ScpiError

BASE_RATE = 6.25e9
ENVELOPES = 10  # acquisitions of an envelope

Codes = NDArray[np.int8] | NDArray[np.int16]
NO_CODES = np.empty((0, 0), np.int8)

MODE_COMMANDS = (
    Setting("ACQuire:STOPAfter", "mode.stop_after", keyword("RUNSTop", "SEQuence")),
    Setting("ACQuire:MODe", "mode.chosen", keyword("SAMple", "PEAKdetect", "HIRes", "AVErage", "WFMDB", "ENVelope")),
    Setting("ACQuire:MODe:ACTUal?", "plan.mode", keyword("SAMple", "PEAKdetect", "HIRes", "AVErage", "ENVelope")),
    Setting("ACQuire:NUMAVg", "mode.averages", integer(2, 10240)),
    Setting("ACQuire:SAMPlingmode", "mode.sampling", keyword("RT", "ET", "IT")),
    Setting("ACQuire:INTERPEightbit", "mode.interpolation", keyword("AUTO", "ON", "OFF"), effect=False),
    Setting("ACQuire:SYNcsamples", "mode.synchronous", boolean),
    Setting("ACQuire:ENHANCEDEnob", "mode.enhanced_enob", keyword("OFF", "AUTO"), effect=False),
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

    def actual(self, sample_rate: float, *, frames: bool) -> str:
        """The mode really used: neither FastFrame nor the highest rates leave the choice."""
        if self._chosen in ("HIRes", "PEAKdetect"):
            return self._chosen if sample_rate < BASE_RATE else "SAMple"
        return "SAMple" if frames else self._chosen

    def triggers(self, actual: str) -> int:
        """Triggers of one acquisition."""
        return {"AVErage": self.averages, "ENVelope": ENVELOPES}.get(actual, 1)


Kept = list[NDArray[Any]]


def fineness(codes: Codes) -> int:
    """How many codes of 16 bits, which is what means are in, one of these is."""
    return 256 if codes.dtype == np.int8 else 1


def kept(mode: str, before: Kept, codes: Codes, points: int) -> Kept:
    """What is kept of triggers: of those `before`, and of `codes` (channels, triggers, samples); `points` a record."""
    if mode == "AVErage":
        total = codes.sum(axis=1, keepdims=True, dtype=np.int64) * fineness(codes)
        return [before[0] + total if before else total]
    if mode == "ENVelope":
        low, high = codes.min(axis=1, keepdims=True), codes.max(axis=1, keepdims=True)
        return [np.minimum(before[0], low), np.maximum(before[1], high)] if before else [low, high]
    blocks = codes.reshape(*codes.shape[:2], points, -1)
    if mode == "HIRes":
        return [*before, np.rint(fineness(codes) * blocks.mean(axis=3)).astype(np.int16)]
    return [*before, interleaved(blocks.min(axis=3), blocks.max(axis=3))]


def run_on(total: Kept, codes: Codes, weight: int) -> Kept:
    """What is kept of an average, the sum of `weight` triggers, after more: each takes the place of its mean once."""
    running = total[0].astype(np.float64)
    for trigger in range(codes.shape[1]):
        running += fineness(codes) * codes[:, trigger : trigger + 1].astype(np.float64) - running / weight
    return [running]


def finished(mode: str, frames: Kept, triggers: int) -> Codes:
    """Codes (channels, frames, samples) of what was kept of `triggers`, at least one."""
    if mode == "AVErage":
        mean: NDArray[np.int16] = np.rint(frames[0] / triggers).astype(np.int16)
        return mean
    if mode == "ENVelope":
        return interleaved(frames[0], frames[1])
    return np.concatenate(frames, axis=1) if len(frames) > 1 else frames[0]


def interleaved(low: Codes, high: Codes) -> Codes:
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


def aligned(codes: Codes, offsets: NDArray[np.float64], sample_rate: float) -> Codes:
    """Codes (channels, triggers, samples) interpolated to where they would be without the triggers' offsets (s)."""
    if not offsets.any():
        return codes
    frequencies = np.fft.rfftfreq(codes.shape[-1], 1 / sample_rate)
    shift = np.exp(-2j * np.pi * np.multiply.outer(offsets, frequencies))
    shifted = np.fft.irfft(np.fft.rfft(codes, axis=-1) * shift, codes.shape[-1], axis=-1)
    limits = np.iinfo(codes.dtype)
    moved = np.clip(np.rint(shifted), limits.min, limits.max)
    return moved.astype(np.int8) if codes.dtype == np.int8 else moved.astype(np.int16)
