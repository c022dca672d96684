"""Whether what came of an experiment is what had to: every figure of its file, column by column."""

from collections.abc import Sequence
from dataclasses import dataclass

from labctl.analysis.intervals import Bound, Statistic, Verdict
from labctl.errors import LabctlError
from labctl.studies.paper.experiments import Requirement, statistic_at
from labctl.studies.paper.reproduction import Column, Reproduced


@dataclass(frozen=True)
class Judged:
    """A figure of one column, and what it must be; None where there is none."""

    figure: Statistic | None
    bound: Bound | None

    @property
    def verdict(self) -> Verdict | None:
        """Whether it keeps its bound; what is not there does not. None = it has no bound."""
        if self.bound is None:
            return None
        return Verdict.NOT_REACHED if self.figure is None else self.bound.verdict(self.figure)


@dataclass(frozen=True)
class Comparison:
    """A figure to reach, and what came out.

    Attributes:
        must: The figure.
        columns: With single triggers and, where the experiment has it, with the mean of several.
        baseline: What a digital method reaches; None if there is nothing to compare with.
        wrong: Why it cannot be judged; empty if it can.
    """

    must: Requirement
    columns: tuple[Judged, ...]
    baseline: Statistic | None = None
    wrong: str = ""

    @property
    def fell_short(self) -> bool:
        """Whether it is not reached in a column, or cannot be judged."""
        return bool(self.wrong) or any(column.verdict is Verdict.NOT_REACHED for column in self.columns)

    @property
    def averages_only(self) -> bool:
        """Whether the mean of several triggers reaches its bound and single ones not theirs, or the same if none."""
        if len(self.columns) < 2 or self.columns[1].verdict is not Verdict.REACHED:
            return False
        single, several = self.columns
        return Judged(single.figure, single.bound or several.bound).verdict is not Verdict.REACHED


def comparisons(reproduced: Reproduced) -> list[Comparison]:
    """All figures that an experiment must reach; one that its file asks for in vain costs none of the others."""
    return [_comparison(must, reproduced.columns) for must in reproduced.experiment.must]


def passed(reproduced: Reproduced) -> bool:
    """Whether no figure falls short: each is reached, or open."""
    return not any(found.fell_short for found in comparisons(reproduced))


def verdicts(reproduced: Reproduced) -> list[Verdict]:
    """Those on every figure with a bound, column by column."""
    found = [column.verdict for comparison in comparisons(reproduced) for column in comparison.columns]
    return [verdict for verdict in found if verdict is not None]


def cause(reproduced: Reproduced) -> str:
    """Why a figure falls short: what is wrong with the experiment's file, or else what the file says; empty if none."""
    if passed(reproduced):
        return ""
    wrong = [f"{found.must.what}: {found.wrong}" for found in comparisons(reproduced) if found.wrong]
    return "; ".join(wrong) or reproduced.experiment.cause


def averages_only(found: Reproduced) -> list[str]:
    """What the mean of several triggers reaches and single ones do not, in words."""
    return [one.must.what for one in comparisons(found) if one.averages_only]


def _comparison(must: Requirement, columns: Sequence[Column]) -> Comparison:
    bounds = (must.bound, must.averaged_bound)[: len(columns)]
    try:
        return Comparison(
            must,
            tuple(
                Judged(must.figure(column.conclusion.here), bound)
                for column, bound in zip(columns, bounds, strict=True)
            ),
            None if must.beside is None else statistic_at(columns[0].conclusion.baseline, must.beside.path),
        )
    except LabctlError as error:
        return Comparison(must, tuple(Judged(None, bound) for bound in bounds), wrong=str(error))
