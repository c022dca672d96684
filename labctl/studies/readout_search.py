"""Which window, interval of features and penalty suit a run: judged on the shots that a readout is trained on alone."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from instruments.units import quantity
from labctl.analysis.evaluation import mean_and_sd, validate
from labctl.analysis.readouts import softmax_readout
from labctl.analysis.splits import enough_splits, random_splits
from labctl.errors import UsageError
from labctl.runs.read.run import open_run
from labctl.runs.sweep_axes import points_of
from labctl.studies.readout_training import bounded_records, kept_apart, require_replaceable, train_readout
from labctl.studies.tasks import one_by_one

AXES = {"window": "s", "tau": "s", "C": ""}
"""What may be searched over, and its unit: T_N, the interval of the features, the inverse of the penalty."""
Accuracy = dict[str, Any]


@dataclass(frozen=True)
class Choice:
    """One way to make a readout; tau_s: None is every sample. Both times in s."""

    window_s: float
    tau_s: float | None = None
    inverse_penalty: float = 1.0


def search_readout(
    directory: Path,
    over: Mapping[str, Sequence[str]],
    *,
    window_s: float,
    ports: tuple[int, ...] | None,
    seed: int,
    out: Path | None,
    carried_out: Callable[[Mapping[int, Callable[[], Accuracy]]], Mapping[int, Accuracy]] = one_by_one,
) -> dict[str, Any]:
    """Judge a softmax readout at every combination of some values, and train and save the best.

    Every choice is judged by random splits of the nine tenths of the images that `train_readout` trains on. The best
    has the highest mean accuracy; of equal ones the fewest features, then the first. Its accuracy on the shots kept
    apart is that of `train_readout`, which saw none of them when it was chosen.

    Args:
        directory: A run.
        over: Values of some of `AXES`, as text with units.
        window_s: T_N where it is not searched over, s.
        ports: Ports that the readout sees; None for all.
        seed: Of all splits.
        out: File to write; None for one in the run's folder `models`.
        carried_out: Who judges the choices.

    Returns:
        What `train_readout` returns, and `search`: for every choice its values, `accuracy`, `sd`, `features`.

    Raises:
        UsageError: an axis or a value is none, or `out` is there and is no readout.
        AnalysisError: a window, interval or port that the run does not have, or too few images.
        RunError: no such run.
    """
    require_replaceable(out)
    grid = points_of(over, zipped=False)
    choices = [_choice(point, window_s) for point in grid]
    found = carried_out(
        {place: partial(_judged, directory, choice, ports, seed) for place, choice in enumerate(choices)}
    )
    rows = [{**point, **found[place]} for place, point in enumerate(grid)]
    best = min(range(len(rows)), key=lambda place: (-rows[place]["accuracy"], rows[place]["features"]))
    trained = train_readout(directory, ports=ports, seed=seed, out=out, **vars(choices[best]))
    return trained | {"search": rows, "best": rows[best]}


def _choice(point: Mapping[str, str], window_s: float) -> Choice:
    if strange := point.keys() - AXES.keys():
        raise UsageError(f"--search {min(strange)}: is nothing to search over: choose from {', '.join(AXES)}")
    try:
        asked = {name: quantity(text, AXES[name]) if AXES[name] else float(text) for name, text in point.items()}
    except ValueError as error:
        said = ", ".join(f"{name}={text}" for name, text in point.items())
        raise UsageError(f"--search {said}: {error}: write C as a number, window and tau as times") from None
    if wrong := [name for name, value in asked.items() if not 0 < value < np.inf]:
        raise UsageError(f"--search {wrong[0]}={point[wrong[0]]}: must be above 0")
    return Choice(asked.get("window", window_s), asked.get("tau"), asked.get("C", 1.0))


def _judged(directory: Path, choice: Choice, ports: tuple[int, ...] | None, seed: int) -> Accuracy:
    with open_run(directory) as run:
        records, _ = bounded_records(run)
    train, _ = kept_apart(records, seed)
    traces, labels, groups = records.traces[train], records.labels[train], records.groups[train]
    readout = softmax_readout(
        ports=ports,
        window_s=choice.window_s,
        sample_interval_s=records.sample_interval_s,
        tau_s=choice.tau_s,
        recorded_ports=records.ports if ports else None,
        inverse_penalty=choice.inverse_penalty,
    )
    features = readout[0].fit_transform(traces)
    splits = random_splits(labels, groups, splits=enough_splits(np.unique(groups).size), seed=seed)
    scores = mean_and_sd(validate(features, labels, splits, readout=readout[1:]).scores)
    return {"accuracy": scores["mean"], "sd": scores["sd"], "features": features.shape[1]}
