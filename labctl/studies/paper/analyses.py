"""The analyses that an experiment file can name, each loaded when it is needed."""

from importlib import import_module
from importlib.util import find_spec

from pydantic import ValidationError

from instruments.toml_files import describe
from labctl.errors import ExperimentError
from labctl.studies.paper.contract import Analysis, AnalysisSettings
from labctl.studies.paper.experiments import Experiment

MODULES = ("recognition", "traces", "cracks", "forecasting", "vowels", "scenes", "imaging")


def analysis_of(experiment: Experiment) -> tuple[Analysis, AnalysisSettings]:
    """The analysis that `experiment` names, and its settings.

    Raises:
        ExperimentError: no such analysis, wrong settings, no such run as it reads, or no torch for one that needs it.
    """
    if experiment.analysis not in MODULES:
        raise ExperimentError(
            f"experiment {experiment.name}: no analysis is called {experiment.analysis!r}: "
            f"choose from {', '.join(MODULES)}"
        )
    analysis: Analysis = import_module(f"labctl.studies.paper.{experiment.analysis}").ANALYSIS
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
