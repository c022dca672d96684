"""What a readout is trained on, from a run file: volts on the window's grid, labels, groups."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.analysis.errors import AnalysisError
from labctl.analysis.windows import resample, volts
from labctl.runs import Run


@dataclass(frozen=True)
class Records:
    """The shots of one kind, in the order they were measured.

    traces: (shots, ports, samples) V, first sample at the trigger. labels, groups: (shots,). ports: waveguide of each
    entry of the second axis. sample_interval_s: s. indices: (shots,) place of each shot in the run.
    """

    traces: NDArray[np.floating]
    labels: NDArray[np.int64]
    groups: NDArray[np.int64]
    ports: tuple[int, ...]
    sample_interval_s: float
    indices: NDArray[np.int64]


def read_records(run: Run, kind: str = "image") -> Records:
    """The shots of `kind` of a run: "image", "reference" or "dark".

    Raises:
        AnalysisError: the run holds none.
    """
    shots: NDArray[Any] = run.shots
    chosen = np.flatnonzero(shots["kind"] == kind)
    if not chosen.size:
        raise AnalysisError(f"{run.path}: holds no {kind} shots: acquire some first")
    frames = volts(run.frames[chosen], run.scale, run.offset)
    interval = run.shape.sample_interval_s
    return Records(
        traces=resample(frames, run.trigger_offset_s[chosen], sample_interval_s=interval),
        labels=shots["label"][chosen].astype(np.int64),
        groups=shots["group"][chosen].astype(np.int64),
        ports=run.ports,
        sample_interval_s=interval,
        indices=chosen,
    )
