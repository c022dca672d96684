"""Images made again from what the detectors saw: error against acquisition time, examples, and a film of a switch."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt

from instruments.units import Seconds
from labctl.analysis.baselines import mean_image_rmse
from labctl.analysis.evaluation import window_key
from labctl.analysis.intervals import NOT_NEGATIVE, pooled
from labctl.analysis.networks import ReconstructionNetwork
from labctl.analysis.reconstruction import KernelReconstruction, LinearReconstruction
from labctl.analysis.regression import rmse
from labctl.analysis.splits import Split
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.film import Film, FilmSettings, film_of, film_results
from labctl.studies.paper.imaging_figures import NAMES, bars, error_curves, filmstrip, reconstructions
from labctl.studies.paper.twin_runs import TAU_S, TwinRuns, window_features


class CurveSettings(BaseModel):
    """Images of one run through some of its wavelengths.

    Attributes:
        key: Its name in the results.
        label: Its name in the figures.
        run: Name of the run.
        wavelengths: How many of the run's wavelengths, the first ones; None = all.
        windows: Acquisition times T_N.
        network_windows: Those at which the paper's network is trained; examples are of the first.
        paper: RMSE in the paper, for the figure.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    label: str
    run: str
    wavelengths: PositiveInt | None = None
    windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    network_windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    paper: float | None = None


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        curves: What is reconstructed.
        network_benches: On how many of the benches the paper's network is trained, the first ones.
        examples: How many test images of each class are shown.
        film: The scene that is filmed; None = none.
    """

    curves: Annotated[tuple[CurveSettings, ...], Field(min_length=1)]
    network_benches: PositiveInt = 5
    examples: PositiveInt = 2
    film: FilmSettings | None = None

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return (*(curve.run for curve in self.curves), *(() if self.film is None else self.film.reads))


@dataclass(frozen=True)
class Reconstructed:
    """One curve on one twin.

    Attributes:
        errors: RMSE (splits,) on the test images, by readout (`NAMES`) and T_N (text, ns).
        mean_image: RMSE (splits,) of answering the mean training image.
        originals: (n, rows, columns) test images of the first split.
        examples: The same through each readout but the linear one.
    """

    errors: dict[str, dict[str, NDArray[np.float64]]]
    mean_image: NDArray[np.float64]
    originals: NDArray[np.float64]
    examples: dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Findings:
    """What one twin shows: its curves by key, and its film."""

    curves: dict[str, Reconstructed]
    film: Film | None


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Train and test every readout of one twin, and look at its scene through them."""
    readouts = [name for name in NAMES if name != "network" or twin.place < settings.network_benches]
    curves = {curve.key: _reconstructed(twin, curve, readouts, settings.examples) for curve in settings.curves}
    return Findings(curves, None if settings.film is None else film_of(twin, settings.film, readouts))


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Pool all twins and splits; examples and film are of the first twin."""
    here: dict[str, Any] = {}
    baseline: dict[str, Any] = {}
    for curve in settings.curves:
        twins = [found.curves[curve.key] for found in findings]
        here[curve.key] = {
            readout: {
                window: pooled(
                    (twin.errors[readout][window] for twin in twins if readout in twin.errors), within=NOT_NEGATIVE
                )
                for window in windows
            }
            for readout, windows in twins[0].errors.items()
        }
        baseline[curve.key] = {"mean_image": pooled((twin.mean_image for twin in twins), within=NOT_NEGATIVE)}
    figures = []
    first = findings[0].curves
    for run in dict.fromkeys(curve.run for curve in settings.curves):
        of_run = [curve for curve in settings.curves if curve.run == run]
        shown = [
            (curve.label, window_key(curve.network_windows[0]), here[curve.key], first[curve.key].examples)
            for curve in of_run
        ]
        figures.append(reconstructions(run, first[of_run[0].key].originals, shown))
    lines = [
        (curve.label, here[curve.key], baseline[curve.key]["mean_image"]["mean"], curve.paper)
        for curve in settings.curves
    ]
    figures.append(bars(lines))
    if any(len(curve.windows) > 1 for curve in settings.curves):
        figures.append(error_curves(lines, tau_s=TAU_S))
    films = [found.film for found in findings if found.film is not None]
    if films:
        here["film"] = film_results(films)
        figures.append(filmstrip(films[0]))
    notes = (
        "RMSE over all pixels of the test images, pixels 0 or 1.",
        f"One network a split, each with first weights of its own, on the first {settings.network_benches} twins, "
        "since it takes seconds. Its answers are not limited to 0..1; those of the linear and of the best readout "
        "(Gaussian kernel ridge) are.",
    )
    return Conclusion(here, baseline, tuple(figures), notes)


ANALYSIS = Analysis(Settings, examine, conclude, needs_torch=True)


def _reconstructed(twin: TwinRuns, curve: CurveSettings, readouts: Sequence[str], examples: int) -> Reconstructed:
    records = twin.records(curve.run, wavelengths=curve.wavelengths)
    images = twin.images_at(curve.run, records.groups)
    pixels = images.reshape(len(images), -1).astype(np.float32)
    splits = twin.random_splits(records)
    chosen = _one_by_one(splits[0], records.labels, examples)
    errors: dict[str, dict[str, NDArray[np.float64]]] = {name: {} for name in readouts}
    shown: dict[str, NDArray[np.float64]] = {}
    for window_s in curve.windows:
        features = window_features(records, window_s)
        for name in errors:
            if name == "network" and window_s not in curve.network_windows:
                continue
            scores = []
            for number, (train, test) in enumerate(splits):
                readout = _readout(name, twin.seed, number).fit(features[train], pixels[train])
                scores.append(rmse(pixels[test], readout.predict(features[test])))
                if number == 0 and name != "linear" and window_s == curve.network_windows[0]:
                    shown[name] = readout.predict(features[chosen]).reshape(-1, *images.shape[1:])
            errors[name][window_key(window_s)] = np.array(scores)
    return Reconstructed(errors, mean_image_rmse(images, splits), images[chosen].astype(np.float64), shown)


def _readout(name: str, seed: int, number: int) -> Any:
    """An unfitted readout by its name; networks of every twin and split start from other weights."""
    if name == "network":
        return ReconstructionNetwork(seed=100 * seed + number)
    return KernelReconstruction() if name == "best" else LinearReconstruction()


def _one_by_one(split: Split, labels: NDArray[np.int64], each: int) -> NDArray[np.intp]:
    """The first test shots of every class, class by class."""
    test = split[1]
    return np.concatenate([test[labels[test] == label][:each] for label in np.unique(labels)])
