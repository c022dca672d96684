"""The last shots of a run that measures, in a file that is replaced several times a second while somebody looks.

They may not be on disk yet, and may never be: what counts is in the shards.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.runs.format.durable import show_file
from labctl.runs.format.own_files import read_own
from labctl.runs.live.arrays import decode, encode

GLIMPSE = "glimpse"
"""Name of the file in a run directory."""
LARGEST = 1 << 26
_ARRAYS = ["shots", "time_s", "codes", "scale_v", "offset_v"]


@dataclass(frozen=True)
class Glimpse:
    """Shots of one pass.

    Attributes:
        pass_index: Which pass.
        shots: (shots,) their places in the plan, in the order in which they were measured.
        time_s: (shots,) when, s since the run began.
        codes: (shots, ports, samples) int8 or int16.
        scale_v, offset_v: (ports,) volts = scale * code + offset.
    """

    pass_index: int
    shots: NDArray[np.int64]
    time_s: NDArray[np.float64]
    codes: NDArray[np.signedinteger[Any]]
    scale_v: NDArray[np.float64]
    offset_v: NDArray[np.float64]


def write_glimpse(directory: Path, glimpse: Glimpse) -> None:
    """Put `glimpse` where a page looks for it, whole or not at all.

    Raises:
        OSError: it cannot be written.
    """
    arrays = {name: getattr(glimpse, name) for name in _ARRAYS}
    show_file(directory / GLIMPSE, encode({"pass": glimpse.pass_index}, arrays))


def read_glimpse(directory: Path) -> Glimpse | None:
    """The last shots of the run in `directory`; None where there are none, or nothing that a run can have written."""
    try:
        values, found = decode(read_own(directory / GLIMPSE, LARGEST), _ARRAYS)
        shots, ports, samples = found["codes"].shape
        shapes = {name: found[name].shape for name in ("shots", "time_s", "scale_v", "offset_v")}
        expected = {"shots": (shots,), "time_s": (shots,), "scale_v": (ports,), "offset_v": (ports,)}
        whole = shots > 0 and ports > 0 and samples > 0 and found["codes"].dtype.kind == "i"
        finite = all(np.isfinite(found[name]).all() for name in ("time_s", "scale_v", "offset_v"))
        if not whole or not finite or shapes != expected or found["shots"].dtype.kind != "i":
            return None
        return Glimpse(int(values["pass"]), **found)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None
