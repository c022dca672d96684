"""A film of one scene: every window of a record read as an image, by readouts that were trained on still images."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from instruments.units import Seconds
from labctl.analysis.dynamic import periodic_windows, settled_windows
from labctl.analysis.errors import AnalysisError
from labctl.analysis.evaluation import mean_and_sd
from labctl.analysis.networks import ReconstructionNetwork
from labctl.analysis.reconstruction import KernelReconstruction
from labctl.analysis.records import read_records
from labctl.analysis.regression import rmse
from labctl.analysis.windows import sample_count
from labctl.reproduction.contract import Material
from labctl.reproduction.shown import shown_images
from labctl.runs import open_run
from protocols.dynamic_scene import DynamicScene
from protocols.image_readout import DRIVE_RATE, DRIVE_SAMPLES


class FilmSettings(BaseModel):
    """The scene that is filmed: the first one of a run.

    Attributes:
        run: Name of the run of scenes.
        still: Name of the run of still images that the readouts are trained on: all but the two of the scene.
        window: Acquisition time of an image.
        leaves: When the mirrors leave, after the switch is commanded.
        arrives: When they are at rest again; both from the DMD's data sheet.
        memory: How long light from before lingers in fibre, chip and detector.
        times: Which windows are shown: the last that starts by each of these times.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    run: str
    still: str
    window: Annotated[Seconds, Field(gt=0)]
    leaves: Annotated[Seconds, Field(ge=0)] = 0.5e-6
    arrives: Annotated[Seconds, Field(ge=0)] = 1.5e-6
    memory: Annotated[Seconds, Field(ge=0)] = 100e-9
    times: Annotated[tuple[Seconds, ...], Field(min_length=1)]


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


def film_of(material: Material, settings: FilmSettings) -> Film:
    """Train on the still images and read every window of the scene.

    Raises:
        AnalysisError: The runs were measured differently, or no window lies before or behind the switch.
    """
    with open_run(material.runs[settings.still]) as run:
        still = read_records(run)
    with open_run(material.runs[settings.run]) as run:
        moving, shots = read_records(run, "scene"), run.shots
    interval = still.sample_interval_s
    if moving.ports != still.ports or moving.sample_interval_s != interval:
        raise AnalysisError(
            "still images and scenes were recorded on other ports or at another rate: measure both alike"
        )
    pair = [int(shots[name][moving.indices[0]]) for name in ("dataset_index", "next_dataset_index")]
    window = sample_count(settings.window, interval)
    period = sample_count(DRIVE_SAMPLES / DRIVE_RATE, interval)
    windows, starts = periodic_windows(moving.traces[0], period=period, window=window)
    switch_s = _switch_after(material, settings.run)
    leaves_s, arrives_s = switch_s + settings.leaves, switch_s + settings.arrives
    old, new = settled_windows(
        starts,
        window=window,
        sample_interval_s=interval,
        leaves_s=leaves_s,
        arrives_s=arrives_s,
        memory_s=settings.memory,
    )
    if not (old.any() and new.any()):
        raise AnalysisError("no window lies wholly before or behind the switch: record for longer, or switch elsewhere")
    train = ~np.isin(still.groups, pair)
    images = shown_images(material, settings.still, still.groups[train])
    features = still.traces[train, :, :window].reshape(len(images), -1)
    seen = windows.reshape(len(windows), -1)
    readouts: dict[str, Any] = {
        "network": ReconstructionNetwork(seed=100 * material.seed, device="cpu"),
        "best": KernelReconstruction(),
    }
    pixels = images.reshape(len(images), -1).astype(np.float32)
    frames = {
        name: readout.fit(features, pixels).predict(seen).reshape(-1, *images.shape[1:])
        for name, readout in readouts.items()
    }
    time_s = np.asarray(starts * interval, np.float64)
    shown = np.searchsorted(time_s, np.array(settings.times) + interval / 2).clip(min=1) - 1
    at_rest = shown_images(material, settings.run, pair).astype(np.float64)
    return Film(time_s, shown, old, new, (leaves_s, arrives_s), at_rest, frames)


def film_results(films: Sequence[Film]) -> dict[str, Any]:
    """RMSE before and after the switch by readout, and when the frames come nearer to the second image for good, us."""
    results: dict[str, Any] = {}
    for name in films[0].frames:
        before = [_error(film.frames[name][film.old], film.pair[0]) for film in films]
        after = [_error(film.frames[name][film.new], film.pair[1]) for film in films]
        switched = [time for film in films if (time := _switch_us(film, name)) is not None]
        results[name] = {
            "before": mean_and_sd(np.array(before)),
            "after": mean_and_sd(np.array(after)),
            "switch_us": mean_and_sd(np.array(switched)) if switched else None,
            "scenes_switched": len(switched),
        }
    return results | {
        "scenes": len(films),
        "mirrors_move_us": [1e6 * moment for moment in films[0].transit_s],
    }


def _switch_after(material: Material, run: str) -> float:
    """When the second image is commanded, s after the record's first sample."""
    protocol = material.protocols[run]
    if not isinstance(protocol, DynamicScene):
        raise AnalysisError(
            f"run {run} holds no scenes but {protocol.name}: name a run of scenes in the film's settings"
        )
    return protocol.switch_after


def _error(frames: NDArray[np.float64], image: NDArray[np.float64]) -> float:
    return rmse(np.broadcast_to(image, frames.shape), frames)


def _switch_us(film: Film, name: str) -> float | None:
    """Start of the first window from which every frame is nearer to the second image."""
    to_old, to_new = (np.sum((film.frames[name] - image) ** 2, axis=(1, 2)) for image in film.pair)
    farther = np.flatnonzero(to_new >= to_old)
    first = int(farther[-1]) + 1 if farther.size else 0
    return float(film.time_s[first] * 1e6) if first < film.time_s.size else None
