"""Figures of a wavelength scan: correlation of the speckle, or of traces, against detuning."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from labctl.reports.canvas import GREY, Level, Series, draw_series, label_curves, panel, place_legend, styled


@styled
def decorrelation_figure(
    detuning_nm: ArrayLike,
    curves: Sequence[tuple[str, ArrayLike]],
    *,
    half_width_nm: float,
    bound_nm: float | None = None,
) -> Figure:
    """Correlation with what was seen at zero detuning, its half width marked.

    Args:
        detuning_nm: (k,) change of wavelength, nm; drawn in pm where small.
        curves: Label and correlation (k,) of each curve; measured first.
        half_width_nm: Detuning at which the first curve falls to one half, nm.
        bound_nm: Largest half width that was stated elsewhere, nm; None = none.
    """
    figure, axes = panel(height=3.6)
    nm = np.asarray(detuning_nm, np.float64)
    factor, unit = (1e3, "pm") if np.max(np.abs(nm)) < 0.5 else (1.0, "nm")
    series = [_series(label, factor * nm, correlation) for label, correlation in curves]
    draw_series(axes, series)
    axes.axhline(0, color=GREY, linewidth=0.6)
    half = factor * half_width_nm
    axes.plot([half, half], [0, 0.5], color=GREY, linestyle="--", linewidth=1)
    axes.plot([min(0.0, factor * float(nm.min())), half], [0.5, 0.5], color=GREY, linestyle="--", linewidth=1)
    clear = {"facecolor": "white", "edgecolor": "none", "pad": 1}
    axes.text(half + 0.02 * np.ptp(axes.get_xlim()), 0.53, f"half width {half:.3g} {unit}", color=GREY, bbox=clear)
    if bound_nm is not None:
        bound = factor * bound_nm
        axes.axvline(bound, color=GREY, linestyle=":", linewidth=1.2, label=f"paper: below {bound:g} {unit}")
    axes.set_xlabel(f"detuning ({unit})")
    axes.set_ylabel("correlation (1 = same)")
    axes.set_ylim(min(-0.05, 1.1 * min(min(one.mean) for one in series)), 1.05)
    place_legend(figure, axes, inside="upper right")
    return figure


@styled
def open_decorrelation_figure(detuning_nm: ArrayLike, correlation: ArrayLike, *, label: str) -> Figure:
    """Correlation (k,) against detuning (k,) in pm, of a scan that is too short or too coarse to mark a half width."""
    figure, axes = panel(height=3.6)
    measured = _series(label, 1e3 * np.asarray(detuning_nm, np.float64), correlation)
    draw_series(axes, [measured])
    lowest = min(-0.05, 1.1 * min(measured.mean))
    axes.set(xlabel="detuning (pm)", ylabel="correlation (1 = same)", ylim=(lowest, 1.05))
    label_curves(axes, [measured], [Level("one half", 0.5)])
    place_legend(figure, axes, inside="upper right")
    return figure


def _series(label: str, detuning: ArrayLike, correlation: ArrayLike) -> Series:
    x, mean = (np.asarray(values, np.float64).tolist() for values in (detuning, correlation))
    return Series(label, x, mean, [0.0] * len(x))
