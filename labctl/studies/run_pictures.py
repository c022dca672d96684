"""Pictures of a run as it was measured: traces, images, codes, drift."""

from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from labctl.engine.inputs import images_for
from labctl.engine.recorded_protocol import protocol_of_manifest, refuse_other_inputs
from labctl.errors import DatasetError, RunError
from labctl.reports.figures.codes import codes_figure
from labctl.reports.figures.drift import drift_figure
from labctl.reports.figures.images import images_figure
from labctl.reports.figures.traces import traces_figure
from labctl.reports.pictures import join_pictures, save_png
from labctl.runs.format.origin import Origin
from labctl.runs.read.run import Run
from labctl.studies.inspection import Look, Part, cannot_be_drawn, is_one_picture, signals
from protocols.base import Images, ProtocolError

MOST_TRACES = 6
MOST_PORTS = 8
MOST_IMAGES = 16


@dataclass(frozen=True)
class Drawn:
    """The pictures that were written, and a line for each that was left out."""

    pictures: tuple[Path, ...]
    left_out: tuple[str, ...]


def draw(run: Run, part: Part, look: Look, place: Path, before: str = "") -> Drawn:
    """Draw traces, images, codes and drift.

    Args:
        run: The run.
        part: What was looked at.
        look: What was seen.
        place: A folder for pictures, or a file .png for one picture of all of them.
        before: What the names of pictures in a folder begin with.

    Raises:
        RunError: the pictures cannot be written.
    """
    try:
        if not is_one_picture(place):
            return _draw(run, part, look, place, before)
        with TemporaryDirectory() as folder:
            drawn = _draw(run, part, look, Path(folder), "")
            join_pictures(drawn.pictures, place)
        return Drawn((place,), drawn.left_out)
    except OSError as error:
        raise cannot_be_drawn(place, error) from None


def _draw(run: Run, part: Part, look: Look, folder: Path, before: str) -> Drawn:
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
    chosen = [shown.places[index] for index in planned["dataset_index"].tolist() if index in shown.places]
    if not chosen or len(chosen) < planned.size:
        raise RunError("no image belongs to these shots")
    return images_figure(shown.images[chosen], [_named(shot) for shot in planned])


def _named(shot: Any) -> str:
    kind = f"class {shot['label']}" if shot["kind"] == "image" and shot["label"] >= 0 else str(shot["kind"])
    return f"{shot['index']}: {kind}"
