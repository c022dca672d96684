"""What an analysis gets and gives: one twin's runs to examine, all twins' findings to conclude from."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from labctl.engine.inputs import inputs_for
from labctl.errors import ExperimentError
from labctl.reports.experiments import ExperimentFigure
from protocols.base import Images, InputsT, Measurement, Sequences


class AnalysisSettings(BaseModel, ABC):
    """The table `[settings]` of an experiment file; every analysis has its own."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    @property
    @abstractmethod
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""


@dataclass(frozen=True)
class Material:
    """What there is of one twin.

    Attributes:
        runs: Name in the experiment file -> run directory.
        protocols: Name in the experiment file -> the protocol as it was carried out, with its seed.
        seed: Seed of images, order, drive and splits; also the twin's.
        splits: How many random splits to evaluate on.
        data: Folder of data sets that is looked at first.
    """

    runs: Mapping[str, Path]
    protocols: Mapping[str, Measurement[Any]]
    seed: int
    splits: int
    data: Path | None = None

    def images(self, run: str) -> Images:
        """The images that a run showed, in any order: their `indices` are `dataset_index` of the shots.

        Raises:
            ExperimentError: the run shows none.
        """
        return self._inputs(run, Images)

    def sequences(self, run: str) -> Sequences:
        """The sequences that a run played, in any order, as for `images`.

        Raises:
            ExperimentError: the run plays none.
        """
        return self._inputs(run, Sequences)

    def _inputs(self, run: str, kind: type[InputsT]) -> InputsT:
        found = inputs_for(self.protocols[run], self.data)
        if not isinstance(found, kind):
            raise ExperimentError(f"runs.{run}: {self.protocols[run].name} gives no {kind.__name__.lower()}")
        return found


@dataclass(frozen=True)
class Conclusion:
    """What all twins say together.

    Attributes:
        here: Results as JSON; a result with a spread is {"mean", "sd"}, pooled over twins and splits.
        baseline: What digital methods reach on the same images or series, in the same form.
        figures: The figures of the paper, drawn from these results.
        notes: What a reader must know to judge the numbers, beside the notes of the experiment file.
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
    examine: Callable[[Material, Any], Any]
    conclude: Callable[[Sequence[Any], Any], Conclusion]
    needs_torch: bool = False
