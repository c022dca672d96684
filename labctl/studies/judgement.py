"""How a run is judged by what lies in its directory: what carries out each kind that a protocol can name."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from labctl.runs.format.layout import RunPaths
from labctl.studies.fibre import measure_fibre
from labctl.studies.readout_evaluation import evaluate_readout
from protocols.base import Judgement


def evaluate_first_readout(directory: Path) -> dict[str, Any] | None:
    """What the first of the readouts trained on a run reaches on it; None if there is none.

    Raises:
        AnalysisError, RunError: as in `evaluate_readout`.
    """
    models = RunPaths(directory).readouts
    return evaluate_readout(models[0], directory) if models else None


JUDGES: Mapping[Judgement, Callable[[Path], dict[str, Any] | None]] = {
    Judgement.READOUT: evaluate_first_readout,
    Judgement.ITSELF: measure_fibre,
}
"""Writes figures and report of a run, and returns what came out; None where something else is needed first."""
