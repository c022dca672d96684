"""A film of one scene: every window of a record read as an image, by readouts that were trained on still images."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from instruments.units import Seconds
from labctl.analysis.intervals import NOT_NEGATIVE, pooled
from labctl.analysis.networks import ReconstructionNetwork
from labctl.analysis.reconstruction import KernelReconstruction
from labctl.analysis.regression import rmse
from labctl.studies.paper.switching import SwitchSettings, read_switching
from labctl.studies.paper.twin_runs import TwinRuns


class FilmSettings(SwitchSettings):
    """The scene that is filmed: the first one of a run, an image from every window.

    Attributes:
        run: Name of the run of scenes.
        still: Name of the run of still images that the readouts are trained on: all but the two of the scene.
        times: Which windows are shown: the last that starts by each of these times.
    """

    run: str
    still: str
    times: Annotated[tuple[Seconds, ...], Field(min_length=1)]

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the film is made of."""
        return (self.run, self.still)


@dataclass(frozen=True)
class Film:
    """What is seen of the scene.

    Attributes:
        time_s: (n,) start of each window, s after the record's first sample.
        shown: (k,) windows that are shown.
        old, new: (n,) windows with nothing but the light of the first image, and of the second.
        transit_s: When the mirrors leave and arrive, s.
        pair: (2, rows, columns) the images on the mirrors before and after.
        frames: (n, rows, columns) images by the name of the readout.
    """

    time_s: NDArray[np.float64]
    shown: NDArray[np.intp]
    old: NDArray[np.bool_]
    new: NDArray[np.bool_]
    transit_s: tuple[float, float]
    pair: NDArray[np.float64]
    frames: dict[str, NDArray[np.float64]]


def film_of(twin: TwinRuns, settings: FilmSettings, names: Sequence[str]) -> Film:
    """Train those of the readouts "network" and "best" that are named on the still images; read every window.

    Raises:
        AnalysisError: The runs do not fit each other, or no window lies before or behind the switch.
    """
    seen = read_switching(twin, settings, scenes=settings.run, still=settings.still)
    pair = seen.pairs[0]
    train = ~np.isin(seen.still.groups, pair)
    images = twin.images_at(settings.still, seen.still.groups[train])
    features, windows = (traces.reshape(len(traces), -1) for traces in (seen.at_rest[train], seen.windows[0]))
    readouts: dict[str, Any] = {
        "network": ReconstructionNetwork(seed=100 * twin.seed),
        "best": KernelReconstruction(),
    }
    pixels = images.reshape(len(images), -1).astype(np.float32)
    frames = {
        name: readout.fit(features, pixels).predict(windows).reshape(-1, *images.shape[1:])
        for name, readout in readouts.items()
        if name in names
    }
    shown = np.searchsorted(seen.time_s, np.array(settings.times) + seen.still.sample_interval_s / 2).clip(min=1) - 1
    return Film(
        time_s=seen.time_s,
        shown=shown,
        old=seen.old,
        new=seen.new,
        transit_s=seen.transit_s,
        pair=twin.images_at(settings.run, pair).astype(np.float64),
        frames=frames,
    )


def film_results(films: Sequence[Film]) -> dict[str, Any]:
    """RMSE before and after the switch by readout, and when the frames come nearer to the second image for good, us.

    A readout that the first film was made with may be missing in others.
    """
    results: dict[str, Any] = {}
    for name in films[0].frames:
        own = [film for film in films if name in film.frames]
        before = [_error(film.frames[name][film.old], film.pair[0]) for film in own]
        after = [_error(film.frames[name][film.new], film.pair[1]) for film in own]
        switched = [time for film in own if (time := _switch_us(film, name)) is not None]
        results[name] = {
            "before": pooled(before, within=NOT_NEGATIVE),
            "after": pooled(after, within=NOT_NEGATIVE),
            "switch_us": pooled(switched, within=NOT_NEGATIVE) if switched else None,
            "scenes": len(own),
            "scenes_switched": len(switched),
        }
    return results | {
        "scenes": len(films),
        "mirrors_move_us": [1e6 * moment for moment in films[0].transit_s],
    }


def _error(frames: NDArray[np.float64], image: NDArray[np.float64]) -> float:
    return rmse(np.broadcast_to(image, frames.shape), frames)


def _switch_us(film: Film, name: str) -> float | None:
    """Start of the first window from which every frame is nearer to the second image."""
    to_old, to_new = (np.sum((film.frames[name] - image) ** 2, axis=(1, 2)) for image in film.pair)
    farther = np.flatnonzero(to_new >= to_old)
    first = int(farther[-1]) + 1 if farther.size else 0
    return float(film.time_s[first] * 1e6) if first < film.time_s.size else None
