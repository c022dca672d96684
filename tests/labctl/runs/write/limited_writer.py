"""Write a run with a limit on the size of any file, as a full disk would have it.

Usage: `limited_writer.py FOLDER LIMIT SAMPLES SHOTS WHEN`; WHEN is "begun" if the disk fills up once the run has begun.
"""

import resource
import sys
from dataclasses import replace
from pathlib import Path

from labctl.errors import RunError
from tests.labctl.runs.conftest import SMALL, begin, measure_missing


def main(directory: Path, limit: int, samples: int, shots: int, when: str) -> None:
    shape = replace(SMALL, shots=60, samples=samples)
    limits = {"begun": resource.RLIM_INFINITY}.get(when, limit), limit
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limits[0], resource.RLIM_INFINITY))
        with begin(directory, shape, shots) as writer:
            resource.setrlimit(resource.RLIMIT_FSIZE, (limits[1], resource.RLIM_INFINITY))
            measure_missing(writer, shape)
    except RunError as error:
        print(error)  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]), sys.argv[5])
