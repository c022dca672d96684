"""The runs of one twin as analyses read them: records, what was shown or played, and the splits that readouts get."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.analysis.splits import Split, random_splits
from labctl.analysis.windows import WindowFeatures, wavelength_rows
from labctl.engine.inputs import inputs_for
from labctl.errors import AnalysisError, ExperimentError
from labctl.runs.read.records import Records, read_records
from labctl.runs.read.run import open_run
from protocols.base import Images, InputsT, Measurement, Sequences

Found = TypeVar("Found")

TAU_S = 40e-12
"""Interval of the features: a sample at 25 GS/s."""
TEST_PART = 0.1
"""Of the images, in every random split."""


@dataclass(frozen=True)
class TwinRuns:
    """What there is of one twin; of one seed, where all are measured on one bench.

    Attributes:
        runs: Name in the experiment file -> run directory.
        protocols: Name in the experiment file -> the protocol as it was carried out, with its seed.
        seed: Seed of images, order, drive and splits; also the twin's.
        splits: How many random splits to evaluate on.
        data: Folder of data sets that is looked at first.
        place: Which of the seeds it is, counted from 0.
        known: What was found `once`, for all runs with the same inputs.
    """

    runs: Mapping[str, Path]
    protocols: Mapping[str, Measurement[Any]]
    seed: int
    splits: int
    data: Path | None = None
    place: int = 0
    known: dict[str, Any] = field(default_factory=dict)

    def once(self, name: str, compute: Callable[[], Found]) -> Found:
        """What `compute` finds without any light; it is the same for single triggers and for their mean."""
        if name not in self.known:
            self.known[name] = compute()
        found: Found = self.known[name]
        return found

    def records(
        self, run: str, kind: str = "image", *, wavelengths: int | None = None, ports: Sequence[int] | None = None
    ) -> Records:
        """The shots of `kind` of a run, at its first `wavelengths` wavelengths and on `ports`; None: at and on all.

        Raises:
            AnalysisError, RunError: The run holds none, or cannot be read.
        """
        with open_run(self.runs[run]) as stored:
            records, present = read_records(stored, kind), stored.shape.wavelength_of_port
        if wavelengths is None and ports is None:
            return records
        rows = wavelength_rows(tuple(dict.fromkeys(present))[:wavelengths], present)
        if ports is not None:
            rows = rows[np.isin(np.array(records.ports)[rows], ports)]
        return replace(records, traces=records.traces[:, rows], ports=tuple(records.ports[row] for row in rows))

    def random_splits(self, records: Records) -> list[Split]:
        """The splits of this twin: a tenth of the images tests.

        Raises:
            AnalysisError: There are too few images.
        """
        chosen = random_splits(records.labels, records.groups, splits=self.splits, test_size=TEST_PART, seed=self.seed)
        return list(chosen)

    def images(self, run: str) -> Images:
        """The images that a run showed, in any order: their `indices` are `dataset_index` of the shots.

        Raises:
            ExperimentError: The run shows none.
        """
        return self._inputs(run, Images)

    def images_at(self, run: str, indices: ArrayLike) -> NDArray[np.bool_]:
        """The images that a run showed as the mirrors were set, found by their index, never by their place.

        Args:
            run: Name of the run in the experiment file.
            indices: (n,) index in the data set of each image wanted; one may come more than once.

        Returns:
            (n, rows, columns), True = on.

        Raises:
            AnalysisError: The run did not show these.
            ExperimentError: The run showed no images.
        """
        shown = self.images(run)
        wanted = np.asarray(indices, np.int64)
        order = np.argsort(shown.indices)
        places = np.searchsorted(shown.indices, wanted, sorter=order).clip(max=shown.indices.size - 1)
        found = order[places]
        if strange := wanted[shown.indices[found] != wanted].tolist():
            raise AnalysisError(
                f"run {run} holds image {strange[0]}, which its protocol did not show: acquire it again"
            )
        images: NDArray[np.bool_] = shown.images[found]
        return images

    def sequences(self, run: str) -> Sequences:
        """The sequences that a run played, in any order, as for `images`.

        Raises:
            ExperimentError: The run plays none.
        """
        return self._inputs(run, Sequences)

    def _inputs(self, run: str, kind: type[InputsT]) -> InputsT:
        found = self.once(f"inputs of {run}", lambda: inputs_for(self.protocols[run], self.data))
        if not isinstance(found, kind):
            raise ExperimentError(f"runs.{run}: {self.protocols[run].name} gives no {kind.__name__.lower()}")
        return found


def window_features(records: Records, window_s: float) -> NDArray[np.floating]:
    """Features (shots, M N) of the first `window_s` of records, a sample every `TAU_S`.

    Raises:
        AnalysisError: The records are shorter.
    """
    window = WindowFeatures(window_s=window_s, tau_s=TAU_S, sample_interval_s=records.sample_interval_s)
    features: NDArray[np.floating] = window.fit_transform(records.traces)
    return features
