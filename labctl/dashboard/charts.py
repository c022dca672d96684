"""Plots with ticks, as HTML and SVG: lines in several colours over one pair of axes. Pure; all text is escaped here."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.dashboard.sketches import escape, thinned

COLOURS = 5
"""Classes of lines, `c0` and on: more lines begin again."""
MOST_TICKS = 6


@dataclass(frozen=True)
class Axis:
    """From where to where, of what, in which unit; values are multiplied by `factor` before they are shown."""

    low: float
    high: float
    unit: str = ""
    factor: float = 1.0

    def place(self, values: ArrayLike) -> NDArray[np.float64]:
        """Where values are between the ends, 0 to 1 and beyond."""
        placed: NDArray[np.float64] = (np.asarray(values, np.float64) - self.low) / ((self.high - self.low) or 1.0)
        return placed

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Places of round values, 0 to 1, with what is written there; the last one has the unit."""
        low, high = self.low * self.factor, self.high * self.factor
        step = _round_step((high - low) / MOST_TICKS)
        values = [count * step for count in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]
        digits = max(0, -math.floor(math.log10(step) + 1e-9))
        texts = [f"{value + 0.0:.{digits}f}" for value in values]
        places = self.place(np.array(values) / self.factor).tolist()
        return list(zip(places, [*texts[:-1], f"{texts[-1]} {self.unit}".strip()] if texts else [], strict=True))


@dataclass(frozen=True)
class Curve:
    """A line: x and y of the same length; its name in the legend, empty for none; `style` is a CSS class."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    name: str = ""
    style: str = "c0"


def colour(place: int) -> str:
    """The class of the line at a place among several."""
    return f"c{place % COLOURS}"


def chart(title: str, curves: Sequence[Curve], x: Axis, y: Axis, *, marks: Sequence[float] = ()) -> str:
    """A plot under its title and legend; `marks` are values of x where a dashed line stands."""
    legend = "".join(f'<span class="key {curve.style}">{escape(curve.name)}</span>' for curve in curves if curve.name)
    grid = "".join(f"M{1000 * at:.0f} 0v1000" for at, _ in x.ticks) + "".join(
        f"M0 {1000 - 1000 * at:.0f}h1000" for at, _ in y.ticks
    )
    limits = "".join(f"M{1000 * at:.0f} 0v1000" for at in x.place(np.array(marks)).tolist())
    drawn = "".join(_drawn(curve, x, y) for curve in curves)
    below = "".join(f'<span style="left:{100 * at:.1f}%">{escape(text)}</span>' for at, text in x.ticks)
    beside = "".join(f'<span style="bottom:{100 * at:.1f}%">{escape(text)}</span>' for at, text in y.ticks)
    return (
        f'<figure class="chart"><figcaption><span>{escape(title)}</span>{legend}</figcaption>'
        f'<div class="y">{beside}</div>'
        f'<svg viewBox="0 0 1000 1000" preserveAspectRatio="none" role="img" aria-label="{escape(title)}">'
        f'<path class="grid" d="{grid}"/><path class="limit" d="{limits}"/>{drawn}</svg>'
        f'<div class="x">{below}</div></figure>'
    )


def _drawn(curve: Curve, x: Axis, y: Axis) -> str:
    """A line through what is between the ends of x; where y is no number it is interrupted."""
    across, up = x.place(curve.x), y.place(curve.y)
    shown = (across >= -1e-6) & (across <= 1 + 1e-6) & np.isfinite(up)
    line = zip(*thinned(across[shown], np.clip(up[shown], -1, 2)), strict=True)
    points = " ".join(f"{1000 * a:.0f},{1000 - 1000 * b:.0f}" for a, b in line)
    return f'<polyline class="{curve.style}" points="{points}"/>'


def _round_step(least: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    if not least > 0 or not math.isfinite(least):
        return 1.0
    power = 10.0 ** math.floor(math.log10(least))
    return next((power * one for one in (1, 2, 5) if power * one >= least * (1 - 1e-9)), 10 * power)
