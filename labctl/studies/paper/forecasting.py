"""Figures S1 and S2: a chaotic series modulates the light in the chip, and the next value is read from the ports.

The prediction of value n + 1 uses samples from the slot of symbol n alone: samples from later on hold light of symbol
n + 1, the answer itself. Every choice (penalty, ports) is made inside the training part.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import PositiveInt

from instruments.ports import port_name
from labctl.analysis.baselines import autoregressive_nmse, echo_state_nmse
from labctl.analysis.intervals import NOT_NEGATIVE, pooled
from labctl.analysis.regression import nmse, ridge_readout
from labctl.analysis.symbols import one_step_ahead, require_causal, symbol_features
from labctl.analysis.threads import one_thread
from labctl.datasets.sequences import load_sequences
from labctl.errors import AnalysisError
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.ports import port_error_figure
from labctl.reports.figures.prediction import prediction_figure
from labctl.reports.figures.responses import responses_figure
from labctl.runs.read.run import open_run
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.sequence_readout import SYMBOL_S

DATA_SET = "santa-fe"
PAPER_NMSE = 0.08
FEW_PORTS = 3
"""From so many ports on the paper finds an NMSE below 0.2."""
SHOWN_STEPS = 200
SHOWN_SYMBOLS = 100


class Settings(AnalysisSettings):
    """Steps are symbols of the run `series`.

    Attributes:
        train: Training steps.
        test: Test steps, following.
        washout: First training steps that are left out, while the chip fills with light of the series.
        per_symbol: Samples N of each symbol.
        held_out: Last training steps on which ports are chosen; the readout is then trained on the whole training part.
        order: Past values of the linear baseline.
        nodes: Nodes of the echo-state network.
    """

    train: PositiveInt = 3000
    test: PositiveInt = 1000
    washout: PositiveInt = 20
    per_symbol: PositiveInt = 4
    held_out: PositiveInt = 750
    order: PositiveInt = 10
    nodes: PositiveInt = 1000

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return ("series",)


@dataclass(frozen=True)
class Findings:
    """What one twin shows.

    Attributes:
        ports: Ports in the order of the run.
        chosen: The same in the order in which forward selection takes them.
        in_order: (M,) test NMSE of the first 1..M ports.
        by_choice: (M,) test NMSE of the first 1..M of `chosen`.
        target: (test,) values to be predicted.
        predicted: (test,) predictions from all ports.
        series: (symbols,) the first values, scaled to -1..1 by the whole stretch, for the figure.
        volts: (ports, samples) V of the same symbols.
        sample_interval_s: s.
        autoregressive: NMSE of the linear baseline.
        echo_state: NMSE of the echo-state network.
    """

    ports: tuple[int, ...]
    chosen: tuple[int, ...]
    in_order: NDArray[np.float64]
    by_choice: NDArray[np.float64]
    target: NDArray[np.float64]
    predicted: NDArray[np.float64]
    series: NDArray[np.float64]
    volts: NDArray[np.float64]
    sample_interval_s: float
    autoregressive: float
    echo_state: float


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """NMSE one step ahead against the number of ports, and of the digital methods on the same stretch.

    Raises:
        AnalysisError: The run is shorter than the steps asked for, or a feature holds light of a later symbol.
    """
    steps = settings.train + settings.test
    series = stretch_and_next(twin)[: steps + 1]
    with open_run(twin.runs["series"]) as run:
        frames, ports, interval = run.volts(), run.ports, run.shape.sample_interval_s
    if series.size < steps + 1 or len(frames) != 1:
        raise AnalysisError(
            f"{settings.train} training and {settings.test} test steps need one sequence of as many symbols"
        )
    features_of = partial(
        symbol_features,
        first_s=0.0,
        symbol_s=SYMBOL_S,
        symbols=steps,
        per_symbol=settings.per_symbol,
        sample_interval_s=interval,
    )
    require_causal(features_of, frames, first_s=0.0, symbol_s=SYMBOL_S, symbols=steps, sample_interval_s=interval)
    features = features_of(frames)[0].reshape(steps, len(ports), settings.per_symbol)
    _, targets = one_step_ahead(series)
    fitted, tested = slice(settings.washout, settings.train), slice(settings.train, steps)
    score = partial(_error, features, targets)
    everything = range(len(ports))
    with one_thread():
        chosen = chosen_ports(features[fitted], targets[fitted], held_out=settings.held_out)
        predicted = _predicted(features, targets, list(everything), fitted, tested)
        in_order, by_choice = (
            np.array([score(list(order[: count + 1]), fitted, tested) for count in everything])
            for order in (everything, chosen)
        )
    shown = series[: min(SHOWN_SYMBOLS, steps)]
    middle, half = (series.max() + series.min()) / 2, np.ptp(series) / 2
    return Findings(
        ports=ports,
        chosen=tuple(ports[place] for place in chosen),
        in_order=in_order,
        by_choice=by_choice,
        target=targets[tested],
        predicted=predicted,
        series=(shown - middle) / half,
        volts=frames[0, :, : shown.size * round(SYMBOL_S / interval)],
        sample_interval_s=interval,
        autoregressive=autoregressive_nmse(series, order=settings.order, train=settings.train, test=settings.test),
        echo_state=twin.once(
            "echo state",
            partial(
                echo_state_nmse,
                series,
                nodes=settings.nodes,
                train=settings.train,
                test=settings.test,
                seed=twin.seed,
            ),
        ),
    )


def stretch_and_next(twin: TwinRuns) -> NDArray[np.float64]:
    """The values that were played and the one after them, (symbols + 1,): the target of the last symbol.

    Raises:
        AnalysisError: The run is of another stretch, or nothing follows it.
    """
    played = twin.sequences("series")
    with open_run(twin.runs["series"]) as run:
        known_by = int(run.shots["dataset_index"][0])
    whole = load_sequences(DATA_SET, directory=twin.data).sequences
    length, symbols = whole.shape[1], played.values.shape[1]
    if symbols == length:
        raise AnalysisError("no value follows the last one of the whole series: set symbols below its length")
    row, start = divmod(known_by, length)
    values = whole[row, start : start + symbols + 1]
    if values.size <= symbols or not (played.values[played.indices == known_by] == values[:-1]).all(axis=1).any():
        raise AnalysisError(f"sequence {known_by} of the run is not the one its protocol plays: measure it again")
    return values


def chosen_ports(features: NDArray[Any], targets: NDArray[Any], *, held_out: int) -> list[int]:
    """Places of the ports in the order of forward selection: each next one lowers the error on held-out steps most.

    Args:
        features: (steps, ports, samples) of training steps only.
        targets: (steps,) of the same.
        held_out: How many of the last steps the error is taken on; trained is on those before.

    Raises:
        AnalysisError: Nothing is left to train on.
    """
    first = len(targets) - held_out
    if first < 1:
        raise AnalysisError(f"{held_out} of {len(targets)} training steps held out: hold out fewer")
    inner, outer = slice(0, first), slice(first, len(targets))
    chosen: list[int] = []
    while len(chosen) < features.shape[1]:
        errors = {
            port: _error(features, targets, [*chosen, port], inner, outer)
            for port in range(features.shape[1])
            if port not in chosen
        }
        chosen.append(min(errors, key=errors.__getitem__))
    return chosen


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """NMSE against the number of ports over all twins; traces and prediction of the first."""
    orders = (("in port order", "in_order"), ("chosen in training", "by_choice"))
    table = {key: np.stack([getattr(one, key) for one in findings]) for _, key in orders}
    counts = list(range(1, 1 + len(findings[0].ports)))
    here: dict[str, Any] = {
        key: {str(count): pooled(errors[:, count - 1], within=NOT_NEGATIVE) for count in counts}
        for key, errors in table.items()
    } | {"chosen": {str(place): list(one.chosen) for place, one in enumerate(findings, start=1)}}
    if several := counts[FEW_PORTS - 1 :]:
        here[f"worst_from_{FEW_PORTS}"] = max(
            (here["by_choice"][str(count)] for count in several), key=itemgetter("mean")
        )
    baseline = {
        f"AR({settings.order})": pooled((one.autoregressive for one in findings), within=NOT_NEGATIVE),
        f"echo-state network of {settings.nodes} nodes": pooled(
            (one.echo_state for one in findings), within=NOT_NEGATIVE
        ),
    }
    curves = [_curve(label, counts, table[key]) for label, key in orders]
    levels = [Level("AR" if name.startswith("AR") else "echo state", one["mean"]) for name, one in baseline.items()]
    first = findings[0]
    return Conclusion(
        here,
        baseline,
        figures=(
            _traces(first),
            ExperimentFigure(
                "prediction",
                prediction_figure(
                    first.target[:SHOWN_STEPS],
                    first.predicted[:SHOWN_STEPS],
                    nmse=nmse(first.target, first.predicted),
                    first_step=settings.train,
                    paper=Level("paper", PAPER_NMSE),
                ),
                f"One step ahead from {len(first.ports)} ports: the first {SHOWN_STEPS} test steps of one twin, target "
                "and prediction above, their difference below.",
            ),
            ExperimentFigure(
                "ports",
                port_error_figure(curves, levels=levels),
                "Error against the number of ports, in the order of the waveguides and in the order of forward "
                "selection inside the training part; means over the twins.",
            ),
        ),
        notes=(
            f"Features of symbol n are {settings.per_symbol} samples of its own slot, nothing later and nothing "
            "interpolated, which is asserted on every run; slots begin a sample before the light that a mean of many "
            "triggers shows.",
            f"Ports are chosen on the last {settings.held_out} of {settings.train} training steps; test steps take no "
            "part in it.",
        ),
    )


def _predicted(
    features: NDArray[Any], targets: NDArray[Any], ports: list[int], fitted: slice, tested: slice
) -> NDArray[np.float64]:
    train, test = (features[steps][:, ports].reshape(-1, len(ports) * features.shape[2]) for steps in (fitted, tested))
    return np.asarray(ridge_readout().fit(train, targets[fitted]).predict(test))


def _error(features: NDArray[Any], targets: NDArray[Any], ports: list[int], fitted: slice, tested: slice) -> float:
    return nmse(targets[tested], _predicted(features, targets, ports, fitted, tested))


def _curve(label: str, counts: Sequence[int], errors: NDArray[np.float64]) -> Series:
    spread = errors.std(axis=0, ddof=1) if len(errors) > 1 else np.zeros(len(counts))
    return Series(label, counts, errors.mean(axis=0).tolist(), spread.tolist())


def _traces(finding: Findings) -> ExperimentFigure:
    samples = finding.volts.shape[1]
    figure = responses_figure(
        np.arange(samples) * finding.sample_interval_s,
        np.repeat(finding.series, samples // finding.series.size),
        finding.volts,
        ports=[port_name(port) for port in finding.ports],
    )
    return ExperimentFigure(
        "responses",
        figure,
        "The series as it modulates the light's phase, and what leaves the chip on each port: "
        f"the first {finding.series.size} symbols.",
    )


ANALYSIS = Analysis(Settings, examine, conclude)
