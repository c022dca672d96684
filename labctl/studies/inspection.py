"""Looking at a run as it was measured: how the range is used, how the bench drifted.

Nothing is learnt here and nothing judged: it is what an operator looks at before that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instruments.ports import port_name
from instruments.remedies import unwritable
from instruments.units import DIGITS
from labctl.analysis.signal_quality import CodeCounts, Drift, drift, no_codes
from labctl.errors import RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.store import is_elsewhere
from labctl.runs.read.run import Run

BLOCK_BYTES = 1 << 23


@dataclass(frozen=True)
class Part:
    """Which shots (places in the run) and which entries of the port axis are looked at; both ascending."""

    shots: NDArray[np.intp]
    ports: NDArray[np.intp]


@dataclass(frozen=True)
class Look:
    """What was seen.

    Attributes:
        ports: name of each port.
        codes: how often each code occurs.
        clipped: (ports,) part of the frames that touch the end of the range.
        drift_s: (references, ports) when each was measured; None where there are fewer than two reference images.
        drift: of the reference images, in V.
    """

    ports: tuple[str, ...]
    codes: CodeCounts
    clipped: NDArray[np.float64]
    drift_s: NDArray[np.float64] | None
    drift: Drift | None


def part_of(run: Run, shots: tuple[int, int] | None, ports: Sequence[int] | None) -> Part:
    """The shots of the plan from the first to the last of `shots`, and all entries of `ports`; None = all.

    Raises:
        RunError: there are none, or a port was not measured.
    """
    index = run.planned["index"]
    chosen = np.arange(index.size) if shots is None else np.flatnonzero((index >= shots[0]) & (index <= shots[1]))
    if not chosen.size:
        there = f"it has shots {index[0]} to {index[-1]}" if index.size else "no shot of it is complete yet"
        raise RunError(f"{run.path}: there is nothing to look at: {there}")
    for port in ports or ():
        if port not in run.ports:
            known = ", ".join(map(str, dict.fromkeys(run.ports)))
            raise RunError(f"{run.path}: port {port} was not measured: choose from {known}")
    return Part(chosen, np.flatnonzero(np.isin(run.ports, ports or run.ports)))


def port_names(run: Run) -> tuple[str, ...]:
    """A name for each entry of the port axis, with the wavelength where a port was measured at several."""
    names = [port_name(port) for port in run.ports]
    if len(set(run.ports)) == len(run.ports):
        return tuple(names)
    return tuple(
        f"{name}, {wavelength:{DIGITS}} nm"
        for name, wavelength in zip(names, run.shape.wavelength_of_port, strict=True)
    )


def look_at(run: Run, part: Part) -> Look:
    """Read a part of a run once, block after block.

    Raises:
        RunError: the run is damaged.
    """
    names = port_names(run)
    codes = no_codes(part.ports.size, run.shape.dtype)
    for rows in _blocks(run, part.shots):
        codes = codes.with_more(run.frames[rows][:, part.ports])
    references = part.shots[run.planned["kind"][part.shots] == "reference"]
    seen, at = None, None
    if references.size >= 2:
        seen = drift(signals(run, references, part.ports))
        passes = np.repeat(np.arange(len(run.shape.passes)), [len(ports) for ports in run.shape.passes])
        at = run.measured_at_s[np.ix_(references, passes[part.ports])]
    return Look(
        tuple(names[place] for place in part.ports),
        codes,
        run.clipped[np.ix_(part.shots, part.ports)].mean(axis=0),
        at,
        seen,
    )


def signals(run: Run, shots: NDArray[np.intp], ports: NDArray[np.intp]) -> NDArray[np.float64]:
    """Records of some shots (ascending places) and entries of the port axis, V, (shots, ports, samples)."""
    return run.volts(shots)[:, ports]


def place_of_pictures(run: Run, out: Path | None) -> Path:
    """Where pictures of a run go: a folder, made now, or a file .png; None = the folder of figures of the run.

    Raises:
        RunError: it cannot be made, or the file's folder is not there.
    """
    beside = not run.path.is_dir() and not is_elsewhere(run.path)
    place = RunPaths(run.path.parent if beside else run.path).figures if out is None else out
    try:
        if is_one_picture(place):
            place.parent.stat()
        else:
            place.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise cannot_be_drawn(place, error) from None
    return place


def is_one_picture(place: Path) -> bool:
    """Whether all pictures go into one file."""
    return place.suffix.lower() == ".png"


def cannot_be_drawn(place: Path, error: OSError) -> RunError:
    """The one line for pictures that cannot be written."""
    elsewhere = "name another place by --out"
    line = unwritable(place, error, elsewhere)
    return RunError(line if line.endswith(elsewhere) else f"{line}, or {elsewhere}")


def _blocks(run: Run, shots: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """The shots in pieces of about `BLOCK_BYTES` of frames."""
    row = len(run.ports) * run.shape.samples * run.shape.dtype.itemsize
    return np.array_split(shots, -(-shots.size * row // BLOCK_BYTES))
