"""Figures of anomaly detection: histograms of scores and receiver operating characteristics."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from labctl.reports.axes import legend_below
from labctl.reports.style import BLACK, BLUE, GREY, STYLE, VERMILLION, look

CORNER = (0.2, 0.8)
"""Largest false and smallest true positive rate of the magnified corner."""


@dataclass(frozen=True)
class RocCurve:
    """How one score separates abnormal from normal images.

    Attributes:
        label: Name of the score.
        false_positive: (k,) share of normal images taken for abnormal, 0..1.
        true_positive: (k,) share of abnormal images found, 0..1.
        auc: Area under the curve, mean.
        auc_sd: Its standard deviation; None = a single one.
    """

    label: str
    false_positive: Sequence[float] | NDArray[np.float64]
    true_positive: Sequence[float] | NDArray[np.float64]
    auc: float
    auc_sd: float | None = None


def scores_figure(
    normal: ArrayLike,
    abnormal: ArrayLike,
    *,
    threshold: float,
    names: tuple[str, str] = ("normal", "crack"),
    score: str = "anomaly score $(y - 1)^2$",
    logarithmic: bool = True,
    bins: int = 40,
) -> Figure:
    """Histograms of the scores of normal and abnormal images with the threshold between them.

    Args:
        normal: (n,) scores of normal images.
        abnormal: (m,) scores of abnormal images, larger on the whole.
        threshold: Score from which an image counts as abnormal.
        names: What the two kinds of image are called.
        score: What the score is.
        logarithmic: Bins spaced by factors; scores of 0 or less fall into the first bin.
        bins: Number of bins.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        axes = figure.add_subplot()
        good, bad = np.asarray(normal, np.float64), np.asarray(abnormal, np.float64)
        edges = _edges(np.concatenate([good, bad]), bins, logarithmic=logarithmic)
        looks: tuple[dict[str, Any], ...] = (
            {"facecolor": BLUE, "edgecolor": BLUE, "alpha": 0.45},
            {"facecolor": "none", "edgecolor": VERMILLION, "hatch": "////", "linewidth": 1.2},
        )
        shares = (good >= threshold).mean(), (bad >= threshold).mean()
        for values, name, share, drawn in zip((good, bad), names, shares, looks, strict=True):
            weights = np.full(values.size, 100 / values.size)
            label = f"{name} ($n$ = {values.size}, {100 * share:.1f} % above)"
            inside = np.clip(values, edges[0], edges[-1])
            axes.hist(inside, list(edges), weights=weights, histtype="stepfilled", label=label, **drawn)
        axes.axvline(threshold, color=BLACK, linestyle="--", linewidth=1.2, label=f"threshold {threshold:.3g}")
        if edges[0] > 0 and logarithmic:
            axes.set_xscale("log")
        axes.set_xlim(edges[0], edges[-1])
        axes.set_xlabel(f"{score} (no unit)")
        axes.set_ylabel("share of images (%)")
        figure.legend(*axes.get_legend_handles_labels(), loc="outside upper center", ncols=3)
    return figure


def _edges(values: NDArray[np.float64], bins: int, *, logarithmic: bool) -> NDArray[np.float64]:
    positive = values[values > 0]
    if not logarithmic or not positive.size:
        return np.linspace(values.min(), max(values.max(), values.min() + 1e-9), bins + 1)
    lowest = max(
        float(positive.min()), float(np.quantile(positive, 0.01)) / 3
    )  # a few tiny scores must not fill the axis
    return np.geomspace(lowest, positive.max() * 1.0001, bins + 1)


def roc_figure(curves: Sequence[RocCurve], *, paper: float | None = None) -> Figure:
    """True against false positive rate, as a whole and magnified in the corner that matters; areas in the legend.

    Args:
        curves: One for each score.
        paper: Area under the curve that the paper reports; None = not stated.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(7.2, 4.0), layout="constrained")
        whole, corner = figure.subplots(1, 2)
        for position, curve in enumerate(curves):
            style = look(position)
            false, true = 100 * np.asarray(curve.false_positive), 100 * np.asarray(curve.true_positive)
            spread = "" if curve.auc_sd is None else f" ± {curve.auc_sd:.3f}"
            label = f"{curve.label}: AUC {curve.auc:.3f}{spread}"
            for axes, every in ((whole, 0.12), (corner, 0.1)):
                axes.plot(
                    false,
                    true,
                    color=style.colour,
                    linestyle=style.dashes,
                    marker=style.marker,
                    markevery=(0.02 * position, every),
                    markersize=4,
                    linewidth=1.4,
                    label=label,
                )
        whole.plot([0, 100], [0, 100], color=GREY, linewidth=0.8, linestyle=":", label="guessing: AUC 0.500")
        whole.set(xlim=(-1, 101), ylim=(-1, 101), aspect="equal", title="whole")
        corner.set(xlim=(0, 100 * CORNER[0]), ylim=(100 * CORNER[1], 100.4), box_aspect=1, title="upper left corner")
        for axes in (whole, corner):
            axes.set_xlabel("false positive rate (%)")
            axes.set_ylabel("true positive rate (%)")
            axes.grid(visible=True)
        words = None if paper is None else f"paper: AUC {paper:.3f}"
        handles, labels = whole.get_legend_handles_labels()
        legend_below(figure, handles, labels, title=words)
    return figure
