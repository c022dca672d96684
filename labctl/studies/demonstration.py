"""The demonstration: the experiment of this name on simulated benches, and a report of the run on the first of them.

Every figure is the mean over several twins (another fibre, another chip, other noise each), because one bench and one
test set of 100 images scatter by several points.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from labctl.bench.signals import Interruption
from labctl.engine.inputs import images_for, inputs_for
from labctl.reports.figures.window import PAPER_CLAIM
from labctl.reports.recognition import Confusion, recognition_report
from labctl.runs.format.layout import run_name
from labctl.studies.paper.experiments import Experiment
from labctl.studies.paper.recognition import Settings, confusions
from labctl.studies.paper.report import as_json, results
from labctl.studies.paper.reproduction import Plan, Reproduced, reproduce
from labctl.studies.paper.twin_runs import TAU_S
from labctl.studies.processes import side_by_side
from labctl.studies.tasks import Interrupted
from protocols.base import Measurement

Progress = Callable[[int, int], None]
"""Called with the number of records that are done and of all."""

SINGLE, SEVERAL = "single triggers", "mean of 16"
"""What the columns are called: frames of one trigger, and of the experiment's averages."""
SHOWN = "chip"
"""The run that is reported."""

PAPER = {
    "accuracy_above": 0.90,
    "from_window_ns": 0.4,
    "images": "1000 digits 0-3, 900 to train and 100 to test",
}


def demonstrate(plan: Plan, *, interruption: Interruption, progress: Progress) -> dict[str, Any] | None:
    """Acquire, train and evaluate on every twin, and write the report; None if it was interrupted.

    Args:
        plan: Of one experiment, a recognition by a run `chip` and others, and of the folder of the run directories.
        interruption: Asked again and again.
        progress: Called again and again.

    Returns:
        The object that `labctl demo --json` prints.

    Raises:
        AnalysisError, DatasetError, InstrumentError, RunError: A run or its analysis failed.
    """
    started = time.perf_counter()
    (experiment,) = plan.experiments
    shown = experiment.protocols[SHOWN]
    name = run_name(datetime.now(UTC), "demo", shown.digest())

    def directory(run: str, protocol: Measurement[Any], _parameters: object) -> str:
        averaged = "" if protocol.averages == experiment.averages[0] else "-averaged"
        return f"{name}-twin-{protocol.seed}" + ("" if run == SHOWN else f"-{run}") + averaged

    plan = replace(plan, name=directory)
    records = _records(plan, experiment)
    try:
        everything, failed = reproduce(plan, interruption=interruption, measured=lambda done: progress(done, records))
    except Interrupted:
        return None
    for error in failed.values():
        raise error
    (found,) = everything
    single, averaged = found.columns
    entry = as_json(found)
    images = len(images_for(shown).labels)
    runs = [
        str(outcome.directory) for one in found.columns for outcomes in one.outcomes.values() for outcome in outcomes
    ]
    return {
        "experiment": experiment.part_of,
        "shots": images,
        "twins": len(found.seeds),
        "first_seed": found.seeds[0],
        "splits": found.splits,
        "shots_per_second": round(float(np.mean([outcome.shots_per_second for outcome in single.outcomes[SHOWN]])), 1),
        **single.conclusion.here,
        "averaged": averaged.conclusion.here,
        "paper": {"statement": experiment.paper} | PAPER,
        "must": entry["must"],
        "passed": entry["passed"],
        "open": entry["open"],
        "run": runs[0],
        "runs": runs,
        "report": str(_report(found, images)),
        "seconds": round(time.perf_counter() - started, 1),
    }


def paper_says(window: str) -> str:
    """The paper's statement about one acquisition time (ns, as text)."""
    return "> 0.90" if float(window) >= 0.4 else "< 0.90"


def _records(plan: Plan, experiment: Experiment) -> int:
    """How many records all runs will have: every shot in as many passes as the ports need on the channels there are."""
    channels = len(plan.station.scope.channels)
    protocols: Iterable[Any] = experiment.protocols.values()
    of_a_twin = sum(len(one.shots(inputs_for(one))) * -(-len(one.ports) // channels) for one in protocols)
    return len(plan.seeds_of(experiment)) * len(experiment.averages) * of_a_twin


def _report(found: Reproduced, images: int) -> Path:
    """Write the report of all twins into the run that is shown."""
    settings = Settings.model_validate(found.experiment.settings)
    titled = list(zip((SINGLE, SEVERAL), found.columns, strict=True))
    return recognition_report(
        found.columns[0].outcomes[SHOWN][0].directory,
        title=found.experiment.title,
        summary=(
            f"{images} images on each of {len(found.seeds)} simulated benches (seeds {found.seeds[0]} to "
            f"{found.seeds[-1]}), {found.splits} random splits each with a tenth of the images to test; softmax "
            "readout of the samples on ports 2-6. Every frame is of a single trigger, and beside it the mean of 16. In "
            "brackets: the interval that holds the mean of all such benches with 95 % confidence; a figure is open "
            "where it holds the bound. Shown below is the run of the first bench."
        ),
        accuracies={
            f"{curve.label}, {title}": column.conclusion.here[curve.key]
            for title, column in titled
            for curve in settings.curves
        },
        results=results(found),
        confusions=[
            Confusion(f"{name}, {title}", counts)
            for title, column in titled
            for name, counts in confusions(column.findings, settings).items()
        ],
        classes=settings.classes,
        chance=1 / len(settings.classes),
        tau_s=TAU_S,
        claim=PAPER_CLAIM if settings.claim else None,
        carried_out=side_by_side,
    )
