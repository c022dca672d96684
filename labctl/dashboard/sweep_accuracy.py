"""How well each run of a sweep is recognised."""

from dataclasses import dataclass
from pathlib import Path

from labctl.errors import LabctlError


@dataclass(frozen=True)
class Recognition:
    """Accuracy of a softmax readout on the whole of each record, its interval of 95 %, and that of chance."""

    accuracy: float
    low: float
    high: float
    chance: float


def recognised(directory: Path, known: Recognition | None) -> tuple[Recognition | None, bool]:
    """Of a run that is there; what was `known` where nothing can be learnt from it. Nothing ever follows."""
    from labctl.analysis.recognition import recognition
    from labctl.runs.read.records import read_records
    from labctl.runs.read.run import open_run

    try:
        with open_run(directory) as opened:
            records = read_records(opened)
        found = recognition(records.traces, records.labels, records.groups, sample_interval_s=records.sample_interval_s)
    except (LabctlError, KeyError, ValueError):
        return known, False
    return Recognition(found.accuracy, *found.interval, found.chance), False
