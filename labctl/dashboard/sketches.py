"""Small pictures as HTML and SVG: traces, accuracy curves, the image on the DMD. Pure; all text is escaped here.

A plot stretches with its place on the page: only its lines are drawn by SVG, all text is HTML of its own size.
"""

import base64
import binascii
import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from labctl.dashboard.state import Image
from labctl.printable import printable

MOST_POINTS = 400
"""Of a line: more cannot be told apart on a page."""


@dataclass(frozen=True)
class Line:
    """A line of a plot: x and y of the same length, and the CSS class that colours it."""

    x: NDArray[np.floating]
    y: NDArray[np.floating]
    style: str = "a"
    dots: bool = False


@dataclass(frozen=True)
class Axes:
    """The ends of the axes, and how they are labelled."""

    x: tuple[float, float]
    y: tuple[float, float]
    x_labels: tuple[str, str]
    y_labels: tuple[str, str]


def escape(text: str) -> str:
    """Text as HTML that shows just it, whatever is in it."""
    return html.escape(printable(text))


def plot(title: str, lines: Sequence[Line], axes: Axes) -> str:
    """A plot under its title."""
    drawn = "".join(_line(line, axes) for line in lines)
    return (
        f'<figure class="plot"><figcaption>{escape(title)}</figcaption>'
        f'<div class="y"><span>{escape(axes.y_labels[1])}</span><span>{escape(axes.y_labels[0])}</span></div>'
        f'<svg viewBox="0 0 1000 1000" preserveAspectRatio="none" role="img" aria-label="{escape(title)}">{drawn}</svg>'
        f'<div class="x"><span>{escape(axes.x_labels[0])}</span><span>{escape(axes.x_labels[1])}</span></div></figure>'
    )


def traces(
    ports: Sequence[str],
    time_s: NDArray[np.floating],
    volts: Sequence[Sequence[Line]],
    ends: Sequence[tuple[float, float]],
) -> str:
    """A plot for each port over the same time: `volts` has the lines of each, y in V, shown between its `ends`."""
    x = (float(time_s[0]), float(time_s[-1])) if time_s.size > 1 else (0.0, 1.0)
    x_labels = (f"{time_s[0] * 1e9:.3g} ns", f"{time_s[-1] * 1e9:.3g} ns") if time_s.size else ("", "")
    return "".join(
        plot(port, lines, Axes(x, (low, high), x_labels, (f"{low * 1e3:.3g} mV", f"{high * 1e3:.3g} mV")))
        for port, lines, (low, high) in zip(ports, volts, ends, strict=True)
    )


def accuracy(title: str, curves: Sequence[tuple[Sequence[int], Sequence[float]]], chance: float | None) -> str:
    """Accuracy against the number of images, one curve for each style a, b."""
    most = max((images[-1] for images, _ in curves if images), default=1)
    lines = [Line(np.array([0.0, most]), np.array([chance, chance]), "chance")] if chance is not None else []
    lines += [
        Line(np.asarray(images, float), np.asarray(reached, float), style, dots=True)
        for (images, reached), style in zip(curves, "ab", strict=False)
        if images
    ]
    return plot(title, lines, Axes((0.0, float(most)), (0.0, 1.0), ("0", f"{most} images"), ("0 %", "100 %")))


def thinned(x: NDArray[np.floating], y: NDArray[np.floating]) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """A line of at most `MOST_POINTS` points: lowest and highest of each stretch, since a peak may be one sample.

    Example:
        >>> import numpy as np
        >>> from labctl.dashboard.sketches import thinned
        >>> x, y = thinned(np.arange(2000.0), np.arange(2000.0) == 777)
        >>> len(x), float(x[y.argmax()])
        (400, 777.0)
    """
    if y.size <= MOST_POINTS:
        return x, y
    length = -(-2 * y.size // MOST_POINTS)
    stretches = np.pad(y, (0, -y.size % length), mode="edge").reshape(-1, length)
    ends = np.sort(np.stack([stretches.argmin(axis=1), stretches.argmax(axis=1)], axis=1), axis=1)
    kept = (ends + length * np.arange(len(stretches))[:, np.newaxis]).ravel()
    return x[kept], y[kept]


def picture(image: Image) -> str:
    """A binary image, its pixels square; nothing if its bits are not as many as its pixels."""
    try:
        packed = np.frombuffer(base64.b64decode(image.bits, validate=True), np.uint8)
    except (binascii.Error, ValueError):
        return ""
    if packed.size != -(-image.rows * image.columns // 8):
        return ""
    pixels = np.unpackbits(packed, count=image.rows * image.columns).reshape(image.rows, image.columns)
    path = "".join(_runs(row, y) for y, row in enumerate(pixels))
    return (
        f'<svg class="image" viewBox="0 0 {image.columns} {image.rows}" shape-rendering="crispEdges" role="img" '
        f'aria-label="image on the DMD"><path d="{path}"/></svg>'
    )


def _runs(row: NDArray[np.uint8], y: int) -> str:
    edges = np.flatnonzero(np.diff(np.concatenate(([0], row, [0]))))
    return "".join(f"M{a} {y}h{b - a}v1h{a - b}z" for a, b in edges.reshape(-1, 2).tolist())


def _line(line: Line, axes: Axes) -> str:
    x, y = thinned(_scaled(line.x, axes.x), 1000 - _scaled(line.y, axes.y))
    points = " ".join(f"{a:.0f},{b:.0f}" for a, b in zip(x, y, strict=True))
    drawn = f'<polyline class="{line.style}" points="{points}"/>'
    if line.dots:  # a line without length: its round cap is a dot that does not stretch
        dots = "".join(f"M{a:.0f} {b:.0f}h0" for a, b in zip(x, y, strict=True))
        drawn += f'<path class="{line.style} dots" d="{dots}"/>'
    return drawn


def _scaled(values: NDArray[np.floating], ends: tuple[float, float]) -> NDArray[np.floating]:
    scaled: NDArray[np.floating] = 1000 * (np.nan_to_num(values) - ends[0]) / ((ends[1] - ends[0]) or 1.0)
    return scaled
