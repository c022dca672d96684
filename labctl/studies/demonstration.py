"""The demonstration: the experiment of this name on simulated benches, and a report of the run on the first of them.

Every figure is the mean over several twins (another fibre, another chip, other noise each), because one bench and one
test set of 100 images scatter by several points.
"""

import time
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from labctl.bench.opening import Access
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.engine.inputs import images_for, inputs_for
from labctl.reports.page import Result
from labctl.reports.recognition import Confusion, recognition_report
from labctl.runs.format.layout import run_name
from labctl.studies.paper.experiments import Experiment, Requirement
from labctl.studies.paper.recognition import Settings, confusions
from labctl.studies.paper.reproduction import Plan, Reproduced, reproduce
from labctl.studies.paper.verdict import passed
from labctl.studies.processes import Interrupted
from protocols.base import Measurement

Progress = Callable[[int, int], None]
"""Called with the number of records that are done and of all."""

SHOWN = "chip"
"""The run that is reported."""

PAPER = {
    "accuracy_above": 0.90,
    "from_window_ns": 0.4,
    "images": "1000 digits 0-3, 900 to train and 100 to test",
}


def demonstrate(
    experiment: Experiment, folder: Path, access: Access = Access(), *, interruption: Interruption, progress: Progress
) -> dict[str, Any] | None:
    """Acquire, train and evaluate on every twin, and write the report; None if it was interrupted.

    Args:
        experiment: What is carried out: a recognition by a run `chip` and others.
        folder: Where the run directories go.
        access: How the simulated benches are opened.
        interruption: Asked again and again.
        progress: Called again and again.

    Returns:
        The object that `labctl demo --json` prints.

    Raises:
        AnalysisError, DatasetError, InstrumentError, RunError: A run or its analysis failed.
    """
    started = time.perf_counter()
    shown = experiment.protocols[SHOWN]
    name = run_name(datetime.now(UTC), "demo", shown.digest())

    def directory(run: str, protocol: Measurement[Any], _parameters: object) -> str:
        return f"{name}-twin-{protocol.seed}" + ("" if run == SHOWN else f"-{run}")

    plan = Plan((experiment,), Station(), folder, access=access, name=directory)
    records = _records(plan, experiment)
    try:
        everything, failed = reproduce(plan, interruption=interruption, measured=lambda done: progress(done, records))
    except Interrupted:
        return None
    for error in failed.values():
        raise error
    (found,) = everything
    images = len(images_for(shown).labels)
    runs = [str(outcome.directory) for outcomes in found.outcomes.values() for outcome in outcomes]
    return {
        "experiment": experiment.part_of,
        "shots": images,
        "twins": len(found.seeds),
        "shots_per_second": round(float(np.mean([outcome.shots_per_second for outcome in found.outcomes[SHOWN]])), 1),
        **found.conclusion.here,
        "paper": {"statement": experiment.paper} | PAPER,
        "passed": passed(found),
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
    return len(plan.seeds_of(experiment)) * of_a_twin


def _report(found: Reproduced, images: int) -> Path:
    """Write the report of all twins into the run that is shown."""
    settings, here = Settings.model_validate(found.experiment.settings), found.conclusion.here
    return recognition_report(
        found.outcomes[SHOWN][0].directory,
        title=found.experiment.title,
        summary=(
            f"{images} images on each of {len(found.seeds)} simulated benches, {found.splits} random splits each with "
            "a tenth of the images to test; softmax readout of the samples on ports 2-6. Shown below is the run of the "
            "first bench."
        ),
        accuracies={curve.label: here[curve.key] for curve in settings.curves},
        results=[_result(must, must.figure(here)) for must in found.experiment.must],
        confusions=[Confusion(title, counts) for title, counts in confusions(found.findings, settings).items()],
        classes=settings.classes,
    )


def _result(must: Requirement, figure: float) -> Result:
    """An accuracy in per cent, a difference of two in points, beside the least that it must be."""
    unit = " points" if must.minus else "%"
    least, reached = f">= {100 * (must.at_least or 0):.0f}{unit}", f"{100 * figure:.1f}{unit}"
    return Result(must.what, must.paper, least, reached, must.kept(figure))
