"""Is there light at all? Found out from probe shots, before anything is recorded.

Light follows the drive and the picture: two records of one picture have their course in time in common, and two records
of noise have none. The correlation of the two says which (R. A. Fisher, Metron 1, 3-32 (1921): its artanh is normal,
of variance 1 / (n - 3) for n independent samples). Light of so few photons that its course is hidden is brighter than
a dark frame in the mean of many.
"""

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from instruments.bench import Bench
from instruments.errors import InstrumentError
from instruments.values import Frames

SURE = 3.0
"""Standard deviations of noise that a correlation must exceed. Of pairs of noise one in 700 does, more where a receiver
is slower than the sampling; the comparison of records with dark ones finds those a little later."""
SURELY_BRIGHTER, FEWEST_DARK = 5.0, 20
"""Standard errors by which the mean of probes must exceed that of dark frames, which is looked at after each pair; and
frames, below which these errors are not known."""
FEWEST_SAMPLES = 3
"""Of a record that has a course in time."""
MOST_SAMPLES, LONGEST_S = 32768, 60.0
"""Of each channel, and for how long, light is looked for in more probes where noise hides it in one: so many samples of
four channels show light of a tenth of the noise, and so many of one channel light of a seventh."""

Capture = Callable[[], Frames]


def while_lit(bench: Bench, capture: Capture) -> Capture:
    """`capture`, before which the bench's observer is asked each time whether light is to stay on for it."""

    def looked() -> Frames:
        bench.observer.while_lit()
        return capture()

    return looked


class InCommon:
    """What records have in common with others of the same picture, channel by channel.

    Attributes:
        samples: of each channel, how many there were beside the means.
    """

    def __init__(self) -> None:
        """Nothing is known yet."""
        self._products = np.zeros((3, 1))
        self.samples = 0

    def add(self, first: Frames, again: Frames) -> None:
        """Take two records of one picture, in whatever vertical ranges."""
        one, other = _course(first), _course(again)
        products = [(one * other).sum(axis=(0, 2)), (one**2).sum(axis=(0, 2)), (other**2).sum(axis=(0, 2))]
        self._products = self._products + np.array(products)
        self.samples += one.shape[0] * (one.shape[2] - 1)

    @property
    def certainty(self) -> float:
        """Standard deviations of noise that the correlation of all channels together amounts to."""
        both, first, again = self._products
        scale = np.sqrt(first * again)
        correlation = np.clip(np.divide(both, scale, out=np.zeros_like(scale), where=scale > 0), -0.999, 0.999)
        return float(np.arctanh(correlation).sum() * math.sqrt(max(self.samples - 3, 0) / scale.size))


class Brightness:
    """By how much frames are brighter than dark ones, which are taken in turns, so that no drift looks like light."""

    def __init__(self) -> None:
        """Nothing is known yet."""
        self._differences: list[NDArray[np.float64]] = []  # of each channel, codes

    def add(self, lit: Sequence[Frames], dark: Frames) -> None:
        """Take frames with light, if there is any, and a dark one, in the same vertical ranges."""
        levels = [frames.codes.mean(axis=(0, 2)) for frames in lit]
        self._differences.append(np.mean(levels, axis=0) - dark.codes.mean(axis=(0, 2)))

    @property
    def certainty(self) -> float:
        """Standard errors that the difference of all channels together amounts to; 0 as long as they are not known."""
        if len(self._differences) < FEWEST_DARK:
            return 0.0
        differences = np.array(self._differences)
        error = differences.std(axis=0, ddof=1) / math.sqrt(len(differences))
        found = np.divide(differences.mean(axis=0), error, out=np.zeros_like(error), where=error > 0)
        return float(abs(found.sum()) / math.sqrt(found.size))


def require_light(
    bench: Bench, probes: Sequence[Capture], first: Frames, again: Frames, dark: Capture | None = None
) -> None:
    """See that light reaches the oscilloscope; where noise hides it in one probe, all of them are taken in pairs.

    A record of one or two samples has no course in time, and nothing is said of it. A laser that knows that it is dark
    is asked before more probes are taken.

    Args:
        bench: takes the probes.
        probes: take a frame of a picture each, which is shown anew.
        first: a frame of the first of them that was taken before.
        again: another one of it.
        dark: takes a frame of dark mirrors, where there are any.

    Raises:
        InstrumentError: no light was found, or the laser's went out.
    """
    if first.codes.shape[2] < FEWEST_SAMPLES:
        return
    common, brightness = InCommon(), Brightness()
    common.add(first, again)
    if common.certainty < SURE:
        bench.laser.require_emission()
    began_s, pairs = bench.now(), 1
    while common.certainty < SURE and brightness.certainty < SURELY_BRIGHTER:
        if common.samples > MOST_SAMPLES or bench.now() - began_s > LONGEST_S:
            raise InstrumentError(
                "bench: no light: probes have nothing in common but noise: check that the laser emits, its "
                "shutter is open, the drive runs, the DMD shows images and all fibres are plugged in"
            )
        probe = probes[pairs % len(probes)]
        pair = probe(), probe()
        common.add(*pair)
        if dark is not None:
            brightness.add(pair, dark())
        pairs += 1


def _course(frames: Frames) -> NDArray[np.float64]:
    """Codes less the mean of their record: that one drifts without any light."""
    return np.asarray(frames.codes - frames.codes.mean(axis=2, keepdims=True), np.float64)
