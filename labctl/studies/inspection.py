"""Looking at a run as it was measured: traces, images, how the range is used, how the bench drifted.

Nothing is learnt here and nothing judged: it is what an operator looks at before that.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from instruments.remedies import unwritable
from labctl.analysis.signal_quality import CodeCounts, Drift, drift, no_codes
from labctl.engine.inputs import images_for
from labctl.engine.resume import protocol_of_manifest, refuse_other_inputs
from labctl.errors import DatasetError, RunError
from labctl.reports.canvas import port_name
from labctl.reports.figures.codes import codes_figure
from labctl.reports.figures.drift import drift_figure
from labctl.reports.figures.images import images_figure
from labctl.reports.figures.traces import traces_figure
from labctl.reports.pictures import join_pictures, save_png
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import is_elsewhere
from labctl.runs.read.run import Run
from protocols.base import Images, ProtocolError

MOST_TRACES = 6
MOST_PORTS = 8
MOST_IMAGES = 16
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


@dataclass(frozen=True)
class Drawn:
    """The pictures that were written, and a line for each that was left out."""

    pictures: tuple[Path, ...]
    left_out: tuple[str, ...]


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
        f"{name}, {wavelength:g} nm" for name, wavelength in zip(names, run.shape.wavelength_of_port, strict=True)
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


def draw(run: Run, part: Part, look: Look, out: Path | None) -> Drawn:
    """Draw traces, images, codes and drift.

    Args:
        run: The run.
        part: What was looked at.
        look: What was seen.
        out: A folder for pictures, or a file .png for one picture of all of them; None = the
            folder of figures of the run.

    Raises:
        RunError: the pictures cannot be written.
    """
    beside = not run.path.is_dir() and not is_elsewhere(run.path)
    figures = RunPaths(run.path.parent if beside else run.path).figures
    try:
        if out is None:
            return _draw(run, part, look, figures, "shown-")
        if out.suffix.lower() != ".png":
            return _draw(run, part, look, out, "")
        with TemporaryDirectory() as folder:
            drawn = _draw(run, part, look, Path(folder), "")
            join_pictures(drawn.pictures, out)
        return Drawn((out,), drawn.left_out)
    except OSError as error:
        where = figures if out is None else out
        raise RunError(unwritable(where, error, "name another place by --out")) from None


def _draw(run: Run, part: Part, look: Look, folder: Path, before: str) -> Drawn:
    folder.mkdir(parents=True, exist_ok=True)
    pictures: list[Path] = []
    left_out: list[str] = []

    def add(name: str, figure: Figure) -> None:
        pictures.append(folder / f"{before}{name}.png")
        save_png(figure, pictures[-1], Origin.of(run.manifest))

    few = slice(MOST_PORTS)
    if len(look.ports) > MOST_PORTS:
        left_out.append(f"the first {MOST_PORTS} of {len(look.ports)} traces a shot are drawn: choose by --ports")
    chosen = _examples(run.planned, part.shots)
    add(
        "traces",
        traces_figure(
            run.time,
            signals(run, chosen, part.ports[few]),
            shots=[f"shot {_named(run.planned[place])}" for place in chosen],
            ports=look.ports[few],
        ),
    )
    try:
        add("images", _images(run, part))
    except (DatasetError, ProtocolError, RunError) as error:
        left_out.append(f"images are left out: {error}")
    add(
        "codes",
        codes_figure(look.codes.first_code, look.codes.counts[few], look.clipped[few].tolist(), ports=look.ports[few]),
    )
    if look.drift is not None and look.drift_s is not None:
        found = (look.drift_s[:, few], look.drift.level[:, few], look.drift.correlation[:, few])
        add("drift", drift_figure(*found, ports=look.ports[few]))
    else:
        left_out.append("drift is left out: it is seen in two or more reference images")
    return Drawn(tuple(pictures), tuple(left_out))


def _blocks(run: Run, shots: NDArray[np.intp]) -> list[NDArray[np.intp]]:
    """The shots in pieces of about `BLOCK_BYTES` of frames."""
    row = len(run.ports) * run.shape.samples * run.shape.dtype.itemsize
    return np.array_split(shots, -(-shots.size * row // BLOCK_BYTES))


def _examples(planned: NDArray[Any], shots: NDArray[np.intp]) -> NDArray[np.intp]:
    """One image of each class and one dark frame where all shots are asked for; otherwise the first shots."""
    if shots.size < planned.size or not np.any(planned["kind"] == "image"):
        return shots[:MOST_TRACES]
    images = shots[planned["kind"] == "image"]
    _, first = np.unique(planned["label"][images], return_index=True)
    dark = shots[planned["kind"] == "dark"][:1]
    return np.sort(np.append(images[np.sort(first)[: MOST_TRACES - dark.size]], dark))


def _images(run: Run, part: Part) -> Figure:
    """The first images of the chosen shots, as the mirrors were set."""
    protocol = protocol_of_manifest(run.path, run.manifest)
    if protocol.takes is not Images:
        raise RunError("the run showed none")
    shown = images_for(protocol)
    refuse_other_inputs(run.path, run.manifest, shown)
    planned = run.planned[part.shots]
    planned = planned[planned["dataset_index"] >= 0][:MOST_IMAGES]
    place = {int(index): number for number, index in enumerate(shown.indices)}
    chosen = [place[int(index)] for index in planned["dataset_index"] if int(index) in place]
    if not chosen or len(chosen) < planned.size:
        raise RunError("no image belongs to these shots")
    return images_figure(shown.images[chosen], [_named(shot) for shot in planned])


def _named(shot: Any) -> str:
    kind = f"class {shot['label']}" if shot["kind"] == "image" and shot["label"] >= 0 else str(shot["kind"])
    return f"{shot['index']}: {kind}"
