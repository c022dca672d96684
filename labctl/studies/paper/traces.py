"""Figure 2: an image of each class, what the fibre carries before the chip, and what the chip makes of it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instruments.ports import port_name
from labctl.analysis.intervals import NOT_NEGATIVE, Statistic, pooled
from labctl.errors import AnalysisError
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.encoding import encoding_figure
from labctl.runs.read.records import Records
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.twin_runs import TwinRuns


class Settings(AnalysisSettings):
    """There are none: the runs are called `input` and `chip`, and are of the same images."""

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return ("input", "chip")


@dataclass(frozen=True)
class Findings:
    """What one twin shows.

    Attributes:
        images: (classes, rows, columns) one image of each class.
        classes: (classes,) its label.
        ports: Port of each trace, 0 = the fibre before the chip.
        time_s: (samples,) s after the trigger.
        volts: (classes, ports, samples) V.
        input_ratio: Smallest rms difference of two classes over the noise, before the chip.
        chip_ratio: The same over all ports of the chip together.
        port_ratio: (ports of the chip,) the same on each port by itself.
    """

    images: NDArray[np.bool_]
    classes: NDArray[np.int64]
    ports: tuple[int, ...]
    time_s: NDArray[np.float64]
    volts: NDArray[np.floating]
    input_ratio: float
    chip_ratio: float
    port_ratio: NDArray[np.float64]


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Traces of one image of each class before and behind the chip, and how far they lie apart.

    Raises:
        AnalysisError: The two runs are not of the same images.
    """
    before, noise_before = _traces_and_noise(twin, "input")
    behind, noise_behind = _traces_and_noise(twin, "chip")
    shown = twin.images("chip")
    classes, first = np.unique(shown.labels, return_index=True)
    indices = shown.indices[first]
    if missing := set(indices.tolist()) - set(before.groups.tolist()):
        raise AnalysisError(f"images {sorted(missing)} were not measured before the chip: give both runs one seed")
    inputs, outputs = (_of_images(records, indices) for records in (before, behind))
    return Findings(
        images=shown.images[first],
        classes=classes,
        ports=(*before.ports, *behind.ports),
        time_s=np.arange(inputs.shape[-1], dtype=np.float64) * before.sample_interval_s,
        volts=np.concatenate([inputs, outputs], axis=1),
        input_ratio=smallest_ratio(inputs, noise_before),
        chip_ratio=smallest_ratio(outputs, noise_behind),
        port_ratio=np.array(
            [smallest_ratio(outputs[:, [port]], noise_behind[[port]]) for port in range(len(behind.ports))]
        ),
    )


def noise_variance(repeats: NDArray[np.floating]) -> NDArray[np.float64]:
    """Variance (ports,), V^2, of frames (shots, ports, samples) of one pattern about their mean.

    Frames that equal another one bit for bit count once: a simulated bench whose noise is "by-state" repeats them when
    it is brought into the same state again.

    Raises:
        AnalysisError: There is one frame only.
    """
    different = np.unique(repeats, axis=0)
    if len(different) < 2:
        raise AnalysisError("one frame of the reference image says nothing about noise: set reference_every to 1")
    return np.asarray(np.var(different, axis=0, ddof=1, dtype=np.float64).mean(axis=-1))


def smallest_ratio(traces: NDArray[np.floating], noise: NDArray[np.floating]) -> float:
    """Smallest rms difference of two of the traces (classes, ports, samples), over the rms noise.

    The noise of both is in their difference and is taken off: two records of one image differ by nothing.

    Args:
        traces: (classes, ports, samples) V.
        noise: (ports,) variance of the noise, V^2.
    """
    least = min(float(np.mean((one - other) ** 2)) for one, other in combinations(traces.astype(np.float64), 2))
    return float(np.sqrt(max(least / np.mean(noise) - 2, 0.0)))


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Ratios over all twins, and the figure of the first."""
    first = findings[0]
    figure = encoding_figure(
        first.images,
        first.time_s,
        first.volts,
        classes=[f'"{label}"' for label in first.classes],
        ports=[port_name(port) for port in first.ports],
    )
    here: dict[str, Any] = {
        "input": _ratios([one.input_ratio for one in findings]),
        "chip": _ratios([one.chip_ratio for one in findings]),
        "single port": _ratios([float(one.port_ratio.min()) for one in findings]),
    }
    caption = (
        "One image of each class, the light in the fibre before the chip, and what leaves the chip on each port, all "
        "under the same drive. Panels of a column share their axis."
    )
    return Conclusion(
        here,
        figures=(ExperimentFigure("traces", figure, caption),),
        notes=(
            "Difference: root mean square over samples and ports, of the two classes that are most alike, less the "
            "noise of both records. Noise: standard deviation of repeated frames of one image, averaged like all "
            "others.",
        ),
    )


def _ratios(values: Sequence[float]) -> Statistic:
    return {**pooled(values, within=NOT_NEGATIVE), "least": min(values)}


def _traces_and_noise(twin: TwinRuns, name: str) -> tuple[Records, NDArray[np.float64]]:
    return twin.records(name), noise_variance(twin.records(name, "reference").traces)


def _of_images(records: Records, indices: NDArray[np.integer]) -> NDArray[np.floating]:
    """The trace of each image (images, ports, samples)."""
    return np.stack([records.traces[np.flatnonzero(records.groups == index)[0]] for index in indices])


ANALYSIS = Analysis(Settings, examine, conclude)
