"""Instruments that lie: from one message on they obey, answer and complain as before, and what they give is wrong.

A lie is in the instrument and not in one reply, so that it is the same whichever question it is asked for.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import cast

import numpy as np
from numpy.typing import NDArray

from sim_backends.virtual.alp.instrument import VirtualAlp
from sim_backends.virtual.instrument import VirtualInstrument
from sim_backends.virtual.oscilloscope.acquisition import AcquisitionSystem
from sim_backends.virtual.oscilloscope.transfer import Trace

Lie = Callable[[VirtualInstrument], None]
Distorted = Callable[[Trace], Trace]


def trace_of(channel: int | None, distorted: Callable[[], Distorted]) -> Lie:
    """What an oscilloscope acquires on `channel`, None for every one, is distorted before anybody gets it.

    `distorted` is asked once for each channel, and may remember what went before.
    """

    def tell(liar: VirtualInstrument) -> None:
        scope = cast(AcquisitionSystem, liar)
        honest, lies = scope.trace, dict[int, Distorted]()

        def trace(number: int) -> Trace | None:
            found = honest(number)
            if found is None or channel not in (None, number):
                return found
            return lies.setdefault(number, distorted())(found)

        scope.trace = trace  # type: ignore[method-assign]

    return tell


def preamble_of(other: Callable[[int], int]) -> Lie:
    """The preamble of a channel is that of the channel which `other` says; the points are its own."""

    def tell(liar: VirtualInstrument) -> None:
        scope = cast(AcquisitionSystem, liar)
        honest, acquired = scope.trace, scope.acquired_trace

        def points(number: int) -> Trace:
            scope.trace = honest  # type: ignore[method-assign]
            found = acquired(number)
            scope.trace = swapped  # type: ignore[method-assign]
            return found

        def swapped(number: int) -> Trace | None:
            return honest(other(number)) or honest(number)

        scope.trace, scope.acquired_trace = swapped, points  # type: ignore[method-assign]

    return tell


def frozen() -> Distorted:
    """The first one comes again and again."""
    kept: list[Trace] = []

    def distort(trace: Trace) -> Trace:
        kept.append(trace)
        del kept[1:]
        return kept[0]

    return distort


def lagging() -> Distorted:
    """The one before comes in its place."""
    kept: list[Trace] = []

    def distort(trace: Trace) -> Trace:
        if not kept or kept[-1] is not trace:
            kept.append(trace)
        del kept[:-2]
        return kept[0]

    return distort


def flat(code: int) -> Distorted:
    """Every sample has the same code."""
    return lambda trace: replace(trace, codes=np.full_like(trace.codes, code))


def scaled(factor: float) -> Distorted:
    """The preamble says so many times the volts."""
    return lambda trace: replace(trace, vertical=trace.vertical._replace(scale_v=trace.vertical.scale_v * factor))


def late(seconds: float) -> Distorted:
    """The sub-sample time of the trigger is wrong."""
    return lambda trace: replace(trace, offsets_s=np.full_like(trace.offsets_s, seconds))


def shows_the_picture_before(liar: VirtualInstrument) -> None:
    """Each picture that is loaded goes where the next one should."""
    dmd = cast(VirtualAlp, liar)
    honest = dmd.put
    kept: list[NDArray[np.uint8]] = []

    def put(identifier: int, offset: int, count: int, data: NDArray[np.uint8]) -> int:
        pictures = np.array(data).reshape(max(1, count), -1)
        kept.append(pictures[-1])
        moved = np.concatenate([kept[0][np.newaxis], pictures[:-1]])
        del kept[:-1]
        return honest(identifier, offset, count, moved.ravel())

    dmd.put = put  # type: ignore[method-assign]


def mirrors_stuck(liar: VirtualInstrument) -> None:
    """The first picture that is started stays, whatever is started after it; pulses come as they should."""
    dmd = cast(VirtualAlp, liar)
    honest = dmd.turned
    kept: list[NDArray[np.uint16]] = []

    def turned(counts: NDArray[np.uint16]) -> NDArray[np.uint16]:
        kept.append(honest(counts)[:1].copy())
        del kept[1:]
        return np.repeat(kept[0], len(counts), axis=0)

    dmd.turned = turned  # type: ignore[method-assign]
