"""CSV, one line a trace: what the shot is, what the port is, and the samples, each headed by its time in s.

Lines that begin with `#` come first: the title, the manifest and the units, each as JSON. The drive is not in it.
"""

import csv
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.runs.export.content import TRACE, Content
from labctl.runs.read.variables import Variable

ENTRY = "pass_of_port"


def write(content: Content, path: Path) -> None:
    """Write all of `content` but the drive to the file `path`, in UTF-8.

    Raises:
        OSError: there is no room.
        RunError: the run is damaged.
    """
    named = {one.name: one for one in content.variables}
    trace = next(one for one in content.variables if one.dims == TRACE)
    columns: dict[tuple[str, ...], list[Variable]] = {
        dims: [one for one in content.variables if one.dims == dims]
        for dims in (("shot",), ("port",), ("shot", "port"), ("shot", "pass"))
    }
    whole = {one.name: one.read((slice(None),)) for one in columns["port",]}
    times = named["time"].read((slice(None),)).tolist()
    order = [one for group in columns.values() for one in group]
    with path.open("x", encoding="utf-8", newline="") as file:
        for name, value in content.attributes.items():
            file.write(f"# {name}: {value}\n")
        units = {one.name: one.unit for one in (*order, trace) if one.unit}
        file.write(
            f"# units: {json.dumps(units)}\n# samples: {trace.name}, headed in s by the {named['time'].meaning}\n"
        )
        table = csv.writer(file, lineterminator="\n")
        table.writerow([*(one.name for one in order), *times])
        for start, traces in content.blocks(trace):
            rows = slice(content.shots.start + start, content.shots.start + start + len(traces))
            read = {one.name: _read(one, rows) for one in order if "shot" in one.dims}
            table.writerows(_lines(columns, whole | read, traces))


def _read(variable: Variable, rows: slice) -> NDArray[Any]:
    return variable.read((rows, *(slice(None),) * (len(variable.dims) - 1)))


def _lines(
    columns: dict[tuple[str, ...], list[Variable]], values: dict[str, NDArray[Any]], traces: NDArray[Any]
) -> Iterator[list[Any]]:
    """One line for each shot and port; of what is known for each pass, that of the port's pass."""
    for shot, port in np.ndindex(traces.shape[:2]):
        place = {
            ("shot",): (shot,),
            ("port",): (port,),
            ("shot", "port"): (shot, port),
            ("shot", "pass"): (shot, int(values[ENTRY][port])),
        }
        line = [values[one.name][place[dims]].item() for dims, group in columns.items() for one in group]
        yield line + traces[shot, port].tolist()
