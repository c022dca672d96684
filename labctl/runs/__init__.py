"""The run directory: what was asked, what was measured, and proof that nothing is missing.

Writing: `RunWriter`. Reading: `open_run`, `list_runs`. Checking: `verify_run`. Every failure a person can meet is a
`RunError` of one line. `labctl.runs.layout` describes the directory.
"""

from labctl.runs.catalogue import RunRow, list_runs
from labctl.runs.layout import FORMAT_VERSION, RunError, RunExists, RunPaths, run_name
from labctl.runs.reading import Run, open_run
from labctl.runs.shots import Durability, Measured, MeasuredBurst, PlayedDrive, RunShape, ShotColumns, ShotFlag
from labctl.runs.verifying import RunReport, verify_run
from labctl.runs.writing import RunWriter

__all__ = [
    "FORMAT_VERSION",
    "Durability",
    "Measured",
    "MeasuredBurst",
    "PlayedDrive",
    "Run",
    "RunError",
    "RunExists",
    "RunPaths",
    "RunReport",
    "RunRow",
    "RunShape",
    "RunWriter",
    "ShotColumns",
    "ShotFlag",
    "list_runs",
    "open_run",
    "run_name",
    "verify_run",
]
