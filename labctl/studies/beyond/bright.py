"""Light with so little noise that photons can be drawn from it: the mean of many triggers of a bright run."""

from collections.abc import Sequence
from dataclasses import replace

from labctl.analysis.photons import photons_of_equal_noise, relative
from labctl.errors import AnalysisError
from labctl.runs.read.records import Records
from labctl.studies.paper.twin_runs import TwinRuns

MOST_NOISE = 0.1
"""What the variance of a bright run's own noise may be of that of the photons drawn from it."""


def bright_light(twin: TwinRuns, run: str, photons: Sequence[float]) -> tuple[Records, float]:
    """The images of a bright run, and with how many photons a sample an ideal counter has as much noise as it has.

    Traces are light in units of the mean over all of them, darkness is zero; `photons` a sample will be drawn from it.

    Raises:
        AnalysisError: The run holds no images, references, dark frames or light, or has more than `MOST_NOISE` of the
            noise of so many photons.
    """
    records, dark = twin.records(run), twin.records(run, "dark").traces.mean(axis=(0, 2))
    light = records.traces - dark[:, None]
    traces = relative(light)
    equal = photons_of_equal_noise(twin.records(run, "reference").traces, light)
    if max(photons) > MOST_NOISE * equal:
        raise AnalysisError(
            f"runs.{run} has as much noise as {equal:,.0f} photons a sample: at most {MOST_NOISE * equal:,.0f} can be "
            f"drawn from its light, not {max(photons):,g}: ask for fewer, or for more averages of {run}"
        )
    return replace(records, traces=traces), equal
