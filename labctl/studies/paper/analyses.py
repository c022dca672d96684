"""What an analysis is, and which ones there are: it examines one twin, and concludes from what it found of all."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from instruments.toml_files import describe
from labctl.errors import ExperimentError
from labctl.reports.experiments import ExperimentFigure
from labctl.studies.paper.experiments import Experiment
from labctl.studies.paper.twin_runs import TwinRuns

MODULES = {
    "recognition": "paper",
    "traces": "paper",
    "cracks": "paper",
    "forecasting": "paper",
    "vowels": "paper",
    "scenes": "paper",
    "imaging": "paper",
    "following": "beyond",
    "ghost_imaging": "beyond",
    "few_photons": "beyond",
    "analogue_readout": "beyond",
    "shortest_time": "beyond",
    "whole_sets": "beyond",
}
"""Package of `labctl.studies` that has the module. Each has its `ANALYSIS`, loaded when an experiment file names it."""


class AnalysisSettings(BaseModel, ABC):
    """The table `[settings]` of an experiment file; every analysis has its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""


@dataclass(frozen=True)
class Conclusion:
    """What all twins say together.

    Attributes:
        here: Results as JSON; a figure over benches is what `labctl.analysis.intervals.pooled` makes of them.
        baseline: What digital methods reach on the same images or series, in the same form.
        figures: The figures of the paper, drawn from these results.
        notes: What a reader must know to judge the numbers, in addition to the notes of the experiment file.
    """

    here: dict[str, Any]
    baseline: dict[str, Any] = field(default_factory=dict)
    figures: tuple[ExperimentFigure, ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Analysis:
    """One kind of analysis.

    Attributes:
        settings: Model of its settings.
        examine: Finds what one twin shows; called in a process of its own, so that its findings must be picklable.
        conclude: Puts the findings of all twins together, in the order of their seeds.
        needs_torch: Whether it works with torch only.
    """

    settings: type[AnalysisSettings]
    examine: Callable[[TwinRuns, Any], Any]
    conclude: Callable[[Sequence[Any], Any], Conclusion]
    needs_torch: bool = False


def analysis_of(experiment: Experiment) -> tuple[Analysis, AnalysisSettings]:
    """The analysis that `experiment` names, and its settings.

    Raises:
        ExperimentError: no such analysis, wrong settings, no such run as it reads, or no torch for one that needs it.
    """
    package = MODULES.get(experiment.analysis)
    if package is None:
        raise ExperimentError(
            f"experiment {experiment.name}: no analysis is called {experiment.analysis!r}: "
            f"choose from {', '.join(MODULES)}"
        )
    analysis: Analysis = import_module(f"labctl.studies.{package}.{experiment.analysis}").ANALYSIS
    if analysis.needs_torch and find_spec("torch") is None:
        raise ExperimentError(
            f"experiment {experiment.name} needs torch, which is not installed: "
            f'pip install "photonic-labctl[imaging]", or leave it out'
        )
    try:
        settings = analysis.settings.model_validate(experiment.settings)
    except ValidationError as error:
        raise ExperimentError(f"experiment {experiment.name}: settings: {describe(error)}") from None
    if missing := set(settings.reads) - experiment.runs.keys():
        raise ExperimentError(
            f"experiment {experiment.name}: the analysis reads runs.{min(missing)}, which the file does not have: "
            f"it has {', '.join(experiment.runs)}"
        )
    return analysis, settings
