"""The figure of anomaly scores: how far normal and abnormal images are apart."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.canvas import BLACK, BLUE, VERMILLION, styled

BINS = 40


@styled
def scores_figure(normal: ArrayLike, crack: ArrayLike, *, threshold: float, score: str) -> Figure:
    """Histograms of the scores of normal images and of cracks with the threshold between them.

    Bins are spaced by factors; scores of 0 or less fall into the first one.

    Args:
        normal: (n,) scores of normal images.
        crack: (m,) scores of images with a crack, larger on the whole.
        threshold: Score from which an image counts as abnormal.
        score: What the score is.
    """
    figure = Figure(figsize=(6.4, 4.0))
    axes = figure.add_subplot()
    normal, crack = np.asarray(normal, np.float64), np.asarray(crack, np.float64)
    edges = _edges(np.concatenate([normal, crack]))
    kinds: tuple[tuple[str, NDArray[np.float64], dict[str, Any]], ...] = (
        ("normal", normal, {"facecolor": BLUE, "edgecolor": BLUE, "alpha": 0.45}),
        ("crack", crack, {"facecolor": "none", "edgecolor": VERMILLION, "hatch": "////", "linewidth": 1.2}),
    )
    for name, values, drawn in kinds:
        weights = np.full(values.size, 100 / values.size)
        label = f"{name} ($n$ = {values.size}, {100 * (values >= threshold).mean():.1f} % above)"
        inside = np.clip(values, edges[0], edges[-1])
        axes.hist(inside, list(edges), weights=weights, histtype="stepfilled", label=label, **drawn)
    axes.axvline(threshold, color=BLACK, linestyle="--", linewidth=1.2, label=f"threshold {threshold:.3g}")
    if edges[0] > 0:
        axes.set_xscale("log")
    axes.set_xlim(edges[0], edges[-1])
    axes.set_xlabel(f"{score} (no unit)")
    axes.set_ylabel("share of images (%)")
    figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center")
    return figure


def _edges(values: NDArray[np.float64]) -> NDArray[np.float64]:
    positive = values[values > 0]
    if not positive.size:
        return np.linspace(values.min(), max(values.max(), values.min() + 1e-9), BINS + 1)
    # a few tiny scores must not fill the axis
    lowest = max(float(positive.min()), float(np.quantile(positive, 0.01)) / 3)
    return np.geomspace(lowest, positive.max() * 1.0001, BINS + 1)
