"""Readouts that follow a fibre that drifts, beside readouts that stay as they were trained."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt

from instruments.units import Seconds
from labctl.analysis.evaluation import window_key
from labctl.analysis.intervals import SHARE, Statistic, pooled
from labctl.analysis.prequential import READOUTS, prequential
from labctl.errors import AnalysisError
from labctl.reports.canvas import Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.following import following_figure
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TwinRuns, window_features


class DriftSettings(BaseModel):
    """One drift: its name in the results, in the figure, and its run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    label: str
    run: str


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        drifts: The drifts.
        windows: Acquisition times T_N; the figure shows the first.
        first: Images that all readouts begin with.
        last: Images at the end on which they are judged.
        block: Images of a point of the figure.
        chance: Accuracy of guessing.
    """

    drifts: Annotated[tuple[DriftSettings, ...], Field(min_length=1)]
    windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    first: PositiveInt
    last: PositiveInt
    block: PositiveInt
    chance: float

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return tuple(drift.run for drift in self.drifts)


Right = Mapping[str, NDArray[np.bool_]]
"""Readout -> (n,) whether it recognised each image after the first ones."""


@dataclass(frozen=True)
class Findings:
    """What one twin shows, by drift and T_N (text, ns)."""

    right: dict[str, dict[str, Right]]


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Carry every readout through every run.

    Raises:
        AnalysisError: A run has fewer images than are judged, or shows one twice.
    """
    right: dict[str, dict[str, Right]] = {}
    for drift in settings.drifts:
        records = twin.records(drift.run)
        right[drift.key] = {}
        for window_s in settings.windows:
            features = window_features(records, window_s)
            found = prequential(features, records.labels, records.groups, first=settings.first)
            if found.places.size != records.labels.size - settings.first or found.places.size < settings.last:
                raise AnalysisError(
                    f"runs.{drift.run}: {found.places.size} images are shown for the first time after the first "
                    f"{settings.first}: measure more, each of them once"
                )
            right[drift.key][window_key(window_s)] = found.right
    return Findings(right)


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Pool all twins: each has one accuracy of its last images."""
    here: dict[str, dict[str, dict[str, Statistic]]] = {
        drift.key: {
            window: {
                name: pooled(
                    [np.mean(found.right[drift.key][window][name][-settings.last :]) for found in findings],
                    within=SHARE,
                )
                for name in READOUTS
            }
            for window in findings[0].right[drift.key]
        }
        for drift in settings.drifts
    }
    shown = window_key(settings.windows[0])
    panels = {
        drift.label: [
            _curve(label, [found.right[drift.key][shown][name] for found in findings], settings)
            for name, label in READOUTS.items()
        ]
        for drift in settings.drifts
    }
    figure = ExperimentFigure(
        "following",
        following_figure(panels, chance=settings.chance),
        f"Accuracy at {shown} ns on each {settings.block} images, before they are learnt, against the number of images "
        "measured; mean and standard deviation over twins.",
    )
    return Conclusion(here, figures=(figure,))


ANALYSIS = Analysis(Settings, examine, conclude)


def _curve(label: str, twins: Sequence[NDArray[np.bool_]], settings: Settings) -> Series:
    """Accuracy block by block; images that are left over at the end belong to no block."""
    blocks = [one[: one.size // settings.block * settings.block].reshape(-1, settings.block) for one in twins]
    accuracy = np.stack([block.mean(axis=1) for block in blocks])
    ends = settings.first + settings.block * np.arange(1, accuracy.shape[1] + 1)
    spread = accuracy.std(axis=0, ddof=1) if len(twins) > 1 else np.zeros(ends.size)
    return Series(label, ends.tolist(), accuracy.mean(axis=0).tolist(), spread.tolist())
