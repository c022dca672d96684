"""Light without noise to speak of, from a run that is bright enough."""

from dataclasses import replace

from labctl.analysis.photons import relative
from labctl.runs.read.records import Records
from labctl.studies.paper.twin_runs import TwinRuns


def bright_light(twin: TwinRuns, run: str) -> Records:
    """The images of a bright run, traces as light in units of the mean over all of them; darkness is zero.

    Raises:
        AnalysisError: The run holds no images, no dark frames, or no light.
    """
    records, dark = twin.records(run), twin.records(run, "dark").traces.mean(axis=(0, 2))
    return replace(records, traces=relative(records.traces - dark[:, None]))
