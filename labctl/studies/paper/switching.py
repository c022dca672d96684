"""Scenes that switch from one image to another: their records cut into windows, and the same windows at rest."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from instruments.units import Seconds
from labctl.analysis.dynamic import periodic_windows, settled_windows
from labctl.analysis.windows import sample_count
from labctl.errors import AnalysisError
from labctl.runs.read.records import Records, read_records
from labctl.runs.read.run import open_run
from labctl.studies.paper.analyses import AnalysisSettings
from labctl.studies.paper.twin_runs import TwinRuns
from protocols.dynamic_scene import DynamicScene
from protocols.image_readout import DRIVE_RATE, DRIVE_SAMPLES


class SwitchSettings(AnalysisSettings):
    """How scenes are read.

    Attributes:
        window: Acquisition time T_N.
        leaves: When the mirrors leave, after the switch is commanded.
        arrives: When they are at rest again; both from the DMD's data sheet.
        memory: How long light from before lingers in fibre, chip and detector.
    """

    window: Annotated[Seconds, Field(gt=0)]
    leaves: Annotated[Seconds, Field(ge=0)] = 0.5e-6
    arrives: Annotated[Seconds, Field(ge=0)] = 1.5e-6
    memory: Annotated[Seconds, Field(ge=0)] = 100e-9


@dataclass(frozen=True)
class Switching:
    """The scenes of one run, a window in every period of the drive, and the still images measured like them.

    Attributes:
        still: The still images.
        at_rest: (shots, ports, samples) of the still images, as long as a window.
        pairs: (scenes, 2) index in the data set of the first and the second image.
        labels: (scenes, 2) their classes.
        windows: (scenes, n, ports, samples) V.
        starts: (n,) first sample of each window.
        old, new: (n,) windows with nothing but the light of the first image, and of the second.
        transit_s: When the mirrors leave and arrive, s after the first sample.
    """

    still: Records
    at_rest: NDArray[np.floating]
    pairs: NDArray[np.int64]
    labels: NDArray[np.int64]
    windows: NDArray[np.floating]
    starts: NDArray[np.intp]
    old: NDArray[np.bool_]
    new: NDArray[np.bool_]
    transit_s: tuple[float, float]

    @property
    def time_s(self) -> NDArray[np.float64]:
        """(n,) start of each window, s after the first sample."""
        return np.asarray(self.starts * self.still.sample_interval_s, np.float64)


def read_switching(twin: TwinRuns, settings: SwitchSettings, *, scenes: str, still: str) -> Switching:
    """Cut the scenes of the run named `scenes` into windows, and the shots of the run named `still` alike.

    Raises:
        AnalysisError: The first run switches no images, one of its images was not measured at rest, the runs were
            recorded differently, or no window lies wholly before or behind the switch.
    """
    protocol = twin.protocols[scenes]
    if not isinstance(protocol, DynamicScene):
        raise AnalysisError(f"runs.{scenes}: {protocol.name} switches no images: use {DynamicScene.name}")
    resting = twin.records(still)
    with open_run(twin.runs[scenes]) as run:
        moving, shots = read_records(run, "scene"), run.shots
    interval = resting.sample_interval_s
    if moving.ports != resting.ports or moving.sample_interval_s != interval:
        raise AnalysisError("still images and scenes differ in ports or sample rate: measure both alike")
    pairs, labels = (
        np.stack([shots[name][moving.indices] for name in (first, f"next_{first}")], axis=1)
        for first in ("dataset_index", "label")
    )
    if missing := set(pairs.ravel().tolist()) - set(resting.groups.tolist()):
        raise AnalysisError(
            f"images {sorted(missing)} of the scenes were not measured at rest: give both runs one seed"
        )
    window, period = (sample_count(length, interval) for length in (settings.window, DRIVE_SAMPLES / DRIVE_RATE))
    cut = [periodic_windows(record, period=period, window=window) for record in moving.traces]
    starts = cut[0][1]
    leaves_s, arrives_s = protocol.switch_after + settings.leaves, protocol.switch_after + settings.arrives
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
    return Switching(
        still=resting,
        at_rest=resting.traces[..., :window],
        pairs=pairs,
        labels=labels,
        windows=np.stack([windows for windows, _ in cut]),
        starts=starts,
        old=old,
        new=new,
        transit_s=(leaves_s, arrives_s),
    )
