"""What a readout made of light loses against a digital one: few levels, crosstalk, a leak, and shared photons."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, PositiveInt

from instruments.units import Seconds
from labctl.analysis.analogue import AnalogueReadout
from labctl.analysis.evaluation import validate, window_key
from labctl.analysis.intervals import NOT_NEGATIVE, SHARE, pooled
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.photons import bits_figure, photons_figure
from labctl.studies.beyond.bright import bright_light
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TAU_S, TwinRuns, window_features


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        run: Run on whose records both readouts are judged.
        bright: Run with less than a tenth of the noise of `photons`, from whose light they are drawn.
        windows: Acquisition times T_N.
        bits: Of an attenuator.
        extinction_db, crosstalk: As in `AnalogueReadout`.
        time_constant: Of the integrator.
        counted_window, counted_bits: T_N and bits where photons are counted.
        photons: Mean photons a sample and port that either readout has.
        chance: Accuracy of guessing.
    """

    run: str
    bright: str
    windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    bits: Annotated[tuple[PositiveInt, ...], Field(min_length=1)]
    extinction_db: float = 20.0
    crosstalk: float = 0.02
    time_constant: Seconds = 1e-9
    counted_window: Seconds
    counted_bits: PositiveInt
    photons: Annotated[tuple[Annotated[float, Field(gt=0)], ...], Field(min_length=1)]
    chance: float = 0.25

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return (self.run, self.bright)

    def readout(self, ports: int, bits: int, **settings: Any) -> AnalogueReadout:
        """The analogue readout of so many ports and bits."""
        return AnalogueReadout(
            ports,
            bits,
            extinction_db=self.extinction_db,
            crosstalk=self.crosstalk,
            time_constant=self.time_constant / TAU_S,
            **settings,
        )


Scores = NDArray[np.float64]


@dataclass(frozen=True)
class Findings:
    """What one twin shows: scores (splits,) of the same splits.

    Attributes:
        digital: By T_N (text, ns).
        trained: By T_N and bits, trained with its levels.
        rounded: The same, the best weights rounded.
        counted_digital, counted: By photons a sample.
        bright: With how many photons a sample a counter has as much noise as the bright run.
    """

    digital: dict[str, Scores]
    trained: dict[str, dict[str, Scores]]
    rounded: dict[str, dict[str, Scores]]
    counted_digital: dict[str, Scores]
    counted: dict[str, Scores]
    bright: float


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Train and test both readouts on the same splits of the same images."""
    records = twin.records(settings.run)
    splits, ports, labels = twin.random_splits(records), len(records.ports), records.labels
    digital: dict[str, Scores] = {}
    trained: dict[str, dict[str, Scores]] = {}
    rounded: dict[str, dict[str, Scores]] = {}
    for window_s in settings.windows:
        window, features = window_key(window_s), window_features(records, window_s)
        digital[window] = validate(features, labels, splits).scores
        for found, changed in ((trained, {}), (rounded, {"sweeps": 0})):
            found[window] = {
                str(bits): validate(features, labels, splits, readout=settings.readout(ports, bits, **changed)).scores
                for bits in settings.bits
            }
    return Findings(digital, trained, rounded, *_counted(twin, settings))


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Pool all twins and splits; a loss is the difference on the same split."""
    windows = [window_key(window_s) for window_s in settings.windows]
    bits, photons = [str(number) for number in settings.bits], [f"{number:g}" for number in settings.photons]
    here: dict[str, Any] = {
        name: {
            window: {
                number: pooled((getattr(found, name)[window][number] for found in findings), within=SHARE)
                for number in bits
            }
            for window in windows
        }
        for name in ("trained", "rounded")
    }
    here["loss"] = {
        window: {
            number: pooled(found.digital[window] - found.trained[window][number] for found in findings)
            for number in bits
        }
        for window in windows
    }
    here["counted"] = {
        number: pooled((found.counted[number] for found in findings), within=SHARE) for number in photons
    }
    here["counted_loss"] = {
        number: pooled(found.counted_digital[number] - found.counted[number] for found in findings)
        for number in photons
    }
    here["bright_noise_photons"] = pooled((found.bright for found in findings), within=NOT_NEGATIVE)
    baseline: dict[str, Any] = {
        "digital": {window: pooled((found.digital[window] for found in findings), within=SHARE) for window in windows},
        "counted_digital": {
            number: pooled((found.counted_digital[number] for found in findings), within=SHARE) for number in photons
        },
    }
    return Conclusion(here, baseline, (_bits(here, baseline, settings), _photons(here, baseline, settings)))


ANALYSIS = Analysis(Settings, examine, conclude)


def _counted(twin: TwinRuns, settings: Settings) -> tuple[dict[str, Scores], dict[str, Scores], float]:
    """Scores of the digital and the analogue readout by photons a sample, of the bright run's light; and its noise."""
    bright, noise = bright_light(twin, settings.bright, settings.photons)
    light = window_features(bright, settings.counted_window)
    splits = twin.random_splits(bright)
    digital, analogue = {}, {}
    for place, photons in enumerate(settings.photons):
        counted = np.random.default_rng((twin.seed, place)).poisson(photons * light)
        digital[f"{photons:g}"] = validate(counted, bright.labels, splits).scores
        readout = settings.readout(len(bright.ports), settings.counted_bits, photons=photons, seed=twin.seed)
        analogue[f"{photons:g}"] = validate(light, bright.labels, splits, readout=readout).scores
    return digital, analogue, noise


def _bits(here: dict[str, Any], baseline: dict[str, Any], settings: Settings) -> ExperimentFigure:
    labels = {"trained": "trained with its levels", "rounded": "rounded"}
    curves = [
        Series.of(f"{label}, {float(window):g} ns", here[name][window])
        for name, label in labels.items()
        for window in here[name]
    ]
    levels = [Level(f"digital, {float(window):g} ns", result["mean"]) for window, result in baseline["digital"].items()]
    return ExperimentFigure(
        "bits",
        bits_figure(curves, chance=settings.chance, levels=levels),
        "Accuracy of the analogue readout against the bits of an attenuator, on the same records as the digital one; "
        "mean and standard deviation over twins and splits.",
    )


def _photons(here: dict[str, Any], baseline: dict[str, Any], settings: Settings) -> ExperimentFigure:
    curves = [
        Series.of("digital", baseline["counted_digital"]),
        Series.of(f"analogue, {settings.counted_bits} bits", here["counted"]),
    ]
    return ExperimentFigure(
        "photons",
        photons_figure(curves, chance=settings.chance),
        f"Accuracy at {settings.counted_window * 1e9:g} ns against photons a sample: counted on every port, or shared "
        "among the pairs of all classes, attenuated and counted there.",
    )
