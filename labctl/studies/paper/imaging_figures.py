"""The figures of reconstructed images: rows of examples, bars and curves of errors, a strip of film."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.bars import Bar, Bars, bars_figure
from labctl.reports.figures.images import ImageRow, filmstrip_figure, image_rows_figure
from labctl.reports.figures.window import rmse_figure
from labctl.studies.paper.film import Film

NAMES = {"network": "network", "best": "best readout", "linear": "linear"}
Line = tuple[str, Mapping[str, Any], float, float | None]
"""Label of a curve, its results by readout and window, RMSE of its mean image, RMSE in the paper."""
Images = NDArray[np.float64]
"""(n, rows, columns)."""
Examples = tuple[str, str, Mapping[str, Any], Mapping[str, Images]]
"""Label of a curve, its T_N (text, ns), its results by readout and window, test images through each readout."""


def reconstructions(run: str, originals: Images, curves: Sequence[Examples]) -> ExperimentFigure:
    """Test images of one run, and below them what every curve makes of them."""
    rows = [ImageRow("original", originals)]
    for label, window, results, examples in curves:
        for name, images in examples.items():
            error = results[name][window]["mean"]
            rows.append(ImageRow(f"{label}: {NAMES[name]}\n{float(window):g} ns, RMSE {error:.3f}", images))
    return ExperimentFigure(
        f"images-{run}",
        image_rows_figure(rows),
        "Test images of the first twin, first split, and what each readout makes of them. The RMSE is that of all test "
        "images of all twins and splits.",
    )


def bars(lines: Sequence[Line]) -> ExperimentFigure:
    """The errors of all readouts at the acquisition time of the network."""
    groups = []
    for label, results, mean_image, paper in lines:
        window = next(iter(results["network"]))
        of_readout = [Bar(NAMES[name], results[name][window]["mean"], results[name][window]["sd"]) for name in NAMES]
        levels = [Level("mean image", round(mean_image, 3))]
        levels += [] if paper is None else [Level("paper, network", paper)]
        groups.append(Bars(f"{label}, {float(window):g} ns", of_readout, levels))
    return ExperimentFigure(
        "errors",
        bars_figure(groups),
        "Error of the reconstructed test images by readout; mean and standard deviation over twins and splits.",
    )


def error_curves(lines: Sequence[Line], *, tau_s: float) -> ExperimentFigure:
    """The best readout's error against acquisition time, with the network's where it was trained."""
    best = [Series.of(f"{label}, best readout", results["best"], unit=1e-9, tag=label) for label, results, *_ in lines]
    network = [
        Series.of(f"{label}, network", results["network"], unit=1e-9, joined=False, alike=position)
        for position, (label, results, *_) in enumerate(lines)
    ]
    return ExperimentFigure(
        "rmse",
        rmse_figure([*best, *network], tau_s=tau_s, levels=[Level("mean image", lines[0][2])]),
        "Error of the reconstructed test images against acquisition time; mean and standard deviation over twins and "
        "splits. Open symbols: the paper's network.",
    )


def filmstrip(film: Film) -> ExperimentFigure:
    """What was on the mirrors, and what the readouts saw of it, at some times around the switch."""
    times = film.time_s[film.shown]
    leaves_s, arrives_s = film.transit_s
    weights = np.clip((times - leaves_s) / (arrives_s - leaves_s), 0, 1)
    on_mirrors = film.pair[0] + (film.pair[1] - film.pair[0]) * np.ceil(weights)[:, np.newaxis, np.newaxis]
    moving = (weights > 0) & (weights < 1)
    on_mirrors[moving] = film.pair.mean(axis=0)
    strips = {"on the mirrors": on_mirrors} | {NAMES[name]: images[film.shown] for name, images in film.frames.items()}
    return ExperimentFigure(
        "film",
        filmstrip_figure(strips, list(times), transit_s=film.transit_s),
        "A scene of the first twin, an image from each window. The readouts were trained on still images without these "
        "two. Grey on the mirrors: pixels that are changing.",
    )
