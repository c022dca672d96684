"""How few photons are enough: accuracy against photons a sample, counted by the bench and by an ideal counter."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from instruments.units import Seconds
from labctl.analysis.evaluation import validate, window_key
from labctl.analysis.intervals import NOT_NEGATIVE, SHARE, pooled
from labctl.analysis.photons import PhotonScale, photon_transfer, photons_needed, scores_at
from labctl.errors import AnalysisError
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.photons import photons_figure
from labctl.runs.read.records import Records
from labctl.studies.beyond.bright import bright_light
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TwinRuns, window_features

LABELS = {"receiver": "receiver", "ideal": "ideal counter"}


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        levels: Runs with more and more light.
        bright: Run with less than a tenth of the noise of `photons`, from whose light they are drawn.
        photons: Photons a sample of the ideal counter, rising.
        windows: Acquisition times T_N.
        wanted: Accuracy for which the photons needed are given.
        chance: Accuracy of guessing.
    """

    levels: Annotated[tuple[str, ...], Field(min_length=1)]
    bright: str
    photons: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=1)]
    windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    wanted: float = 0.9
    chance: float = 0.25

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return (*self.levels, self.bright)


Scores = NDArray[np.float64]


@dataclass(frozen=True)
class Findings:
    """What one twin shows.

    Attributes:
        photons: Measured mean photons a sample of each level; one whose photons cannot be counted is left out.
        receiver: Scores (splits,) by T_N (text, ns) and level.
        ideal: Scores (splits,) of the ideal counter by T_N and photons a sample (text).
        bright: With how many photons a sample a counter has as much noise as the bright run.
    """

    photons: dict[str, float]
    receiver: dict[str, dict[str, Scores]]
    ideal: dict[str, dict[str, Scores]]
    bright: float


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Count the photons of every level and judge its readout; the same with Poisson numbers of the bright run."""
    windows = {window_key(window_s): window_s for window_s in settings.windows}
    photons: dict[str, float] = {}
    receiver: dict[str, dict[str, Scores]] = {window: {} for window in windows}
    for level in settings.levels:
        records = twin.records(level)
        try:
            scale = photon_scale(twin, level)
        except AnalysisError:  # on some port of this bench the receiver's own noise is more
            continue
        photons[level] = float(scale.photons(records.traces).mean())
        for window, window_s in windows.items():
            receiver[window][level] = _scores(twin, records, window_s)
    if not photons:
        raise AnalysisError(
            "photons cannot be told from the receiver's own noise at any level of light: use a quieter receiver"
        )
    light, bright = bright_light(twin, settings.bright, settings.photons)
    ideal: dict[str, dict[str, Scores]] = {window: {} for window in windows}
    for place, mean in enumerate(settings.photons):
        counted = np.random.default_rng((twin.seed, place)).poisson(mean * light.traces).astype(np.float64)
        for window, window_s in windows.items():
            ideal[window][f"{mean:g}"] = _scores(twin, replace(light, traces=counted), window_s)
    return Findings(photons, receiver, ideal, bright)


def photon_scale(twin: TwinRuns, run: str) -> PhotonScale:
    """What a photon is in the records of a run, by its reference images and dark frames.

    Raises:
        AnalysisError: too few of them, or noise that does not grow with the light.
    """
    return photon_transfer(twin.records(run, "reference").traces, twin.records(run, "dark").traces)


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Pool all twins and splits, the receiver's at the ideal counter's photons as far as all twins have so many."""
    fewest = max(min(found.photons.values()) for found in findings)
    most = min(max(found.photons.values()) for found in findings)
    uncounted = dict(Counter(level for found in findings for level in settings.levels if level not in found.photons))
    here: dict[str, Any] = {
        "photons": {
            level: pooled((found.photons[level] for found in findings if level in found.photons), within=NOT_NEGATIVE)
            for level in settings.levels
            if level not in uncounted or uncounted[level] < len(findings)
        },
        "benches_not_counted": uncounted,
        "bright_noise_photons": pooled((found.bright for found in findings), within=NOT_NEGATIVE),
        "receiver": {
            window: {
                f"{photons:g}": pooled(
                    (
                        scores_at(list(found.photons.values()), list(found.receiver[window].values()), photons)
                        for found in findings
                    ),
                    within=SHARE,
                )
                for photons in settings.photons
                if fewest <= photons <= most
            }
            for window in findings[0].receiver
        },
        "ideal": {
            window: {
                photons: pooled((found.ideal[window][photons] for found in findings), within=SHARE)
                for photons in scores
            }
            for window, scores in findings[0].ideal.items()
        },
    }
    needed = {
        counter: {
            window: photons_needed(
                [float(photons) for photons in results],
                [result["mean"] for result in results.values()],
                settings.wanted,
            )
            for window, results in here[counter].items()
        }
        for counter in LABELS
    }
    drawn = [
        Series.of(f"{label}, {float(window):g} ns", results)
        for counter, label in LABELS.items()
        for window, results in here[counter].items()
    ]
    figure = ExperimentFigure(
        "photons",
        photons_figure(drawn, chance=settings.chance, levels=[Level(f"{100 * settings.wanted:g} %", settings.wanted)]),
        "Accuracy on test images against photons a sample; mean and standard deviation over twins and splits. Photons "
        "of the receiver are measured in its own records, those of the ideal counter drawn.",
    )
    return Conclusion(
        here | {"photons_needed": needed},
        figures=(figure,),
        notes=_needed(needed, settings.wanted) + _not_counted(uncounted, len(findings)),
    )


def _not_counted(uncounted: Mapping[str, int], benches: int) -> tuple[str, ...]:
    return tuple(
        f"{level}: on {count} of {benches} benches the noise of photons cannot be told from the receiver's own on some "
        f"port; left out there."
        for level, count in uncounted.items()
    )


ANALYSIS = Analysis(Settings, examine, conclude)


def _scores(twin: TwinRuns, records: Records, window_s: float) -> Scores:
    return validate(window_features(records, window_s), records.labels, twin.random_splits(records)).scores


def _needed(needed: dict[str, dict[str, float | None]], wanted: float) -> tuple[str, ...]:
    """Photons needed, in words, a line for each T_N."""
    return tuple(
        f"{100 * wanted:g} % at {float(window):g} ns needs, between the points of the curves, "
        + ", ".join(
            f"{LABELS[counter]}: " + ("more than was tried" if photons is None else f"{photons:.2g} photons a sample")
            for counter, photons in ((counter, windows[window]) for counter, windows in needed.items())
        )
        + "."
        for window in needed["ideal"]
    )
