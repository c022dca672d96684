"""The experiments: one TOML file each under `protocols/experiments/`; a new file is a new experiment."""

from collections.abc import Mapping, Sequence
from functools import cached_property
from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, PositiveInt, ValidationError, model_validator

from instruments.remedies import unreadable
from instruments.toml_files import TomlError, describe, read_toml
from instruments.units import Seconds
from labctl.analysis.intervals import Bound, Statistic, difference
from labctl.errors import ExperimentError
from protocols.base import Measurement
from protocols.registry import protocol_from

FOLDER = Path(str(files("protocols") / "experiments"))
SERIES = {"all": "paper", "beyond": "beyond"}
"""What stands on the command line for the experiments of a series together."""


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class PlannedRun(_Table):
    """A run that the experiment needs.

    Attributes:
        protocol: Its protocol, by name.
        settings: The protocol's settings, without the seed.
        parameters: Physical parameters of the twin that differ from the station's for this run.
    """

    protocol: str
    settings: dict[str, Any] = {}
    parameters: dict[str, float | int | bool | str] = {}


class Baseline(_Table):
    """What a digital method reaches on the same data: in words, and the keys that lead to it in `baseline`."""

    what: str
    path: tuple[str, ...]


class Requirement(_Table):
    """A figure to reach, or one that is printed beside them.

    Attributes:
        what: In words.
        path: Keys that lead to the figure in `here`: a mean over benches, as `pooled` gives it.
        minus: Keys of another figure that is subtracted, bench by bench; empty: none.
        at_least, at_most: The bound of single triggers, the paper's statement; at most one of the two.
        averaged_at_least, averaged_at_most: The bound of the mean of several triggers; none: that of single triggers.
        paper: What the paper says.
        percent: Whether to print it in per cent, and a difference in points.
        difference: Whether the figure at `path` is a difference by itself, as with `minus`.
        beside: A digital baseline to compare with; of a difference, what it is of.
    """

    what: str
    path: tuple[str, ...] = Field(min_length=1)
    minus: tuple[str, ...] = ()
    at_least: float | None = None
    at_most: float | None = None
    averaged_at_least: float | None = None
    averaged_at_most: float | None = None
    paper: str = ""
    percent: bool = False
    difference: bool = False
    beside: Baseline | None = None

    @model_validator(mode="after")
    def _one_bound_each(self) -> Self:
        for prefix in ("", "averaged_"):
            if None not in (getattr(self, f"{prefix}at_least"), getattr(self, f"{prefix}at_most")):
                raise ValueError(f"{self.what!r} needs one bound: give {prefix}at_least or {prefix}at_most")
        return self

    @property
    def bound(self) -> Bound | None:
        """What the figure must be with single triggers; None = it is printed only."""
        return _bound(self.at_least, self.at_most)

    @property
    def averaged_bound(self) -> Bound | None:
        """What the figure must be with the mean of several triggers; None = it is printed only."""
        return _bound(self.averaged_at_least, self.averaged_at_most) or self.bound

    def figure(self, here: Mapping[str, Any]) -> Statistic:
        """The figure in `here`.

        Raises:
            ExperimentError: there is none.
            AnalysisError: the two that are subtracted are not of the same benches.
        """
        figure = statistic_at(here, self.path)
        return difference(figure, statistic_at(here, self.minus)) if self.minus else figure


def _bound(at_least: float | None, at_most: float | None) -> Bound | None:
    if at_most is not None:
        return Bound("<=", at_most)
    return None if at_least is None else Bound(">=", at_least)


class Variation(_Table):
    """A parameter of the twin and the values it is given.

    Attributes:
        name: In words, with the unit of `values` in brackets.
        parameter: Its name in the twin's parameters.
        values: In the unit that `name` says.
        unit, exponent: A value v stands for the parameter `unit` * v ** `exponent`, in its own unit.
        default: What every experiment uses, in the unit of `values`.
        logarithmic: Whether the values are spaced by factors.
    """

    name: str
    parameter: str
    values: tuple[float, ...]
    unit: float = 1.0
    exponent: int = 1
    default: float
    logarithmic: bool = False

    def parameter_at(self, value: float) -> float:
        """The twin's parameter that one of `values` stands for."""
        return self.unit * value**self.exponent


class SensitivityStudy(_Table):
    """How a result depends on the twin: accuracy of one run at one acquisition time, parameter by parameter."""

    run: str
    window: Seconds
    twins: PositiveInt = 3
    quick_twins: PositiveInt = 1
    required: float | None = None
    parameters: tuple[Variation, ...]


class FitStudy(_Table):
    """A parameter of the twin that is fitted to what the paper says of one curve: where it crosses an accuracy.

    Attributes:
        run: The run whose accuracy it is.
        variation: The parameter and the values that are tried.
        accuracy: Below it at the shorter of `windows`, above it at the longer.
        windows: The two acquisition times.
        first_seed, twins: Seeds that are used for nothing else.
    """

    run: str
    variation: Variation
    accuracy: float
    windows: tuple[Seconds, Seconds]
    first_seed: PositiveInt
    twins: PositiveInt = 10


class Experiment(_Table):
    """One experiment.

    Attributes:
        name: Its name on the command line: that of its file.
        title: A few words.
        paper: What the paper reached, in short.
        statement: What is done here, a few sentences.
        analysis: Name of the analysis.
        series: Whether the paper has it, or it goes beyond; only what goes beyond may change the twin's parameters.
        averages: Triggers whose mean a frame is. With two numbers the runs are carried out with either: single
            triggers first, the mean of several beside it. Empty: as the runs' settings say.
        part_of: The experiment that this one repeats a part of; it is then carried out by name only, not among all.
        twins: Over how many twins it is repeated.
        splits: On how many random splits each twin's readouts are judged.
        quick_twins, quick_splits: The same for a quick look.
        runs: What must be acquired, by name.
        settings: Settings of the analysis.
        must: Figures to reach.
        sensitivity: What `--sensitivity` varies.
        fit: What `--fit` fits.
        notes: Pitfalls, and what a reader must know to judge the figures.
        cause: Why a figure falls short where one does; printed only then.
    """

    name: str
    title: str
    paper: str
    statement: str
    analysis: str
    series: Literal["paper", "beyond"] = "paper"
    averages: tuple[PositiveInt, ...] = Field((), max_length=2)
    part_of: str = ""
    twins: PositiveInt = 10
    splits: PositiveInt = 10
    quick_twins: PositiveInt = 1
    quick_splits: PositiveInt = 2
    runs: dict[str, PlannedRun] = Field(min_length=1)
    settings: dict[str, Any] = {}
    must: tuple[Requirement, ...] = ()
    sensitivity: SensitivityStudy | None = None
    fit: FitStudy | None = None
    notes: tuple[str, ...] = ()
    cause: str = ""

    @model_validator(mode="after")
    def _one_twin_for_the_paper(self) -> Self:
        for name, run in self.runs.items():
            if run.parameters and self.series == "paper":
                raise ValueError(
                    f"runs.{name}.parameters: all experiments of the paper share one twin: leave them out, or say "
                    "series = 'beyond'"
                )
        return self

    @model_validator(mode="after")
    def _averages_are_said_once(self) -> Self:
        for name, run in self.runs.items():
            if self.averages and "averages" in run.settings:
                raise ValueError(f"runs.{name}.settings.averages: the experiment's own averages say it: leave it out")
        for must in self.must:
            if len(self.averages) < 2 and must.averaged_bound != must.bound:
                raise ValueError(f"{must.what!r}: averaged_at_least, averaged_at_most need averages = [1, 16] above")
        return self

    @cached_property
    def protocols(self) -> dict[str, Measurement[Any]]:
        """The protocols of the runs, with their default seed, and single triggers unless their settings say otherwise.

        Raises:
            ProtocolError: no such protocol or setting.
        """
        return {
            name: protocol_from(run.protocol, run.settings, origin=f"experiment {self.name}, runs.{name}")
            for name, run in self.runs.items()
        }


def experiments(names: Sequence[str] = ("all",), *, folder: Path = FOLDER) -> tuple[Experiment, ...]:
    """The experiments called by name, in the order of their names; 'all' and 'beyond' stand for a series.

    Of a series those are left out that are a part of another.

    Raises:
        ExperimentError: no such experiment, or a file that is wrong.
    """
    paths = {path.stem: path for path in sorted(folder.glob("*.toml"))}
    for name in names:
        if name not in paths and name not in SERIES:
            raise ExperimentError(
                f"no experiment is called {name!r}: choose 'all', 'beyond' or from {', '.join(paths)}"
            )
    series = {SERIES[name] for name in names if name in SERIES}
    read = [_read(path) for name, path in paths.items() if series or name in names]
    if found := tuple(one for one in read if one.name in names or (one.series in series and not one.part_of)):
        return found
    raise ExperimentError(
        f"{folder}: holds no experiment of series {', '.join(sorted(series))}: name one that it holds"
    )


def _read(path: Path) -> Experiment:
    try:
        return Experiment.model_validate(read_toml(path) | {"name": path.stem})
    except OSError as error:
        raise ExperimentError(unreadable(path, error, "name another experiment")) from None
    except TomlError as error:
        raise ExperimentError(f"{path}: is not TOML ({error}): correct that line") from None
    except ValidationError as error:
        raise ExperimentError(f"{path}: {describe(error)}") from None


def found_at(results: Mapping[str, Any], path: Sequence[str]) -> Any:
    """What the keys in `path` lead to.

    Raises:
        ExperimentError: nothing.
    """
    value: Any = results
    for key in path:
        if not isinstance(value, Mapping) or key not in value:
            raise ExperimentError(
                f"the analysis gives no figure {'.'.join(path)}: correct `must` in the experiment file"
            )
        value = value[key]
    return value


def statistic_at(results: Mapping[str, Any], path: Sequence[str]) -> Statistic:
    """The figure over benches that the keys in `path` lead to.

    Raises:
        ExperimentError: there is none.
    """
    value = found_at(results, path)
    if not isinstance(value, dict) or "by_bench" not in value:
        raise ExperimentError(
            f"the analysis gives no figure over benches {'.'.join(path)}: correct `must` in the experiment file"
        )
    return value
