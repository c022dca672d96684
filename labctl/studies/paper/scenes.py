"""Figure 4: the image on the mirrors changes while a single long record is taken, and a sliding window recognises it.

The readout is that of the still images. It never saw the images of the scenes, and the scenes that are judged are those
whose two images it recognises at rest: the question is what happens while the image changes.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from sklearn.pipeline import Pipeline

from instruments.units import Seconds
from labctl.analysis.dynamic import short_time_correlation, sliding_probabilities, switch_time
from labctl.analysis.intervals import NOT_NEGATIVE, SHARE, Statistic, counted, pooled
from labctl.analysis.readouts import softmax_readout
from labctl.analysis.threads import one_thread
from labctl.errors import AnalysisError
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.switch import switch_figure
from labctl.studies.paper.analyses import Analysis, Conclusion
from labctl.studies.paper.switching import Switching, SwitchSettings, read_switching
from labctl.studies.paper.twin_runs import TwinRuns

MOST_OFF_S = 1e-6
"""A switch is seen in time if it is seen so far at most from when the mirrors move."""
CERTAIN = 0.5
"""More probable than all other classes together."""


class Settings(SwitchSettings):
    """How the runs `static` (still images) and `scenes` of one seed are read."""

    window: Annotated[Seconds, Field(gt=0)] = 0.56e-9

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return ("static", "scenes")


@dataclass(frozen=True)
class Scene:
    """What is seen of one scene.

    Attributes:
        labels: Class of the first and of the second image.
        at_rest: Whether the readout recognises each of them in its one frame at rest.
        certain: Whether it does so with a probability above `CERTAIN`.
        time_s: (n,) start of each window, s after the record's first sample.
        old, new: (n,) windows with nothing but the light of the first image, and of the second.
        transit_s: When the mirrors leave and arrive, s.
        probabilities: (n, classes) in ascending order of the classes.
        correlations: (2, n) correlation with the still first and second image.
        stays_s: Time from which the second class stays the most probable; None = it does not.
        crossing_s: Time from which the second image is the more alike; None = it is not.
    """

    labels: tuple[int, int]
    at_rest: tuple[bool, bool]
    certain: tuple[bool, bool]
    time_s: NDArray[np.float64]
    old: NDArray[np.bool_]
    new: NDArray[np.bool_]
    transit_s: tuple[float, float]
    probabilities: NDArray[np.float64]
    correlations: NDArray[np.float64]
    stays_s: float | None
    crossing_s: float | None


@dataclass(frozen=True)
class Findings:
    """What one twin shows: the classes in ascending order, and its scenes in the order of the run."""

    classes: NDArray[np.int64]
    scenes: tuple[Scene, ...]

    def judged(self) -> list[Scene]:
        """Scenes both images of which are recognised at rest."""
        return [scene for scene in self.scenes if all(scene.at_rest)]

    def verdict(self, scene: Scene) -> tuple[bool, bool]:
        """Whether the mean probability names the first image before the switch, and the second one after it."""
        means = [scene.probabilities[windows].mean(axis=0) for windows in (scene.old, scene.new)]
        named = self.classes[np.argmax(means, axis=1)]
        return bool(named[0] == scene.labels[0]), bool(named[1] == scene.labels[1])

    def share_right(self, scene: Scene) -> float:
        """Share of single windows, before and after the switch, whose most probable class is that on the mirrors."""
        named = self.classes[scene.probabilities.argmax(axis=1)]
        before, after = scene.labels
        return float(np.mean(np.concatenate([named[scene.old] == before, named[scene.new] == after])))


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Train on the still images, and follow every scene.

    Raises:
        AnalysisError: An image of a scene was not measured at rest, or the runs do not fit each other.
    """
    seen = read_switching(twin, settings, scenes="scenes", still="static")
    readout = _readout(seen, settings)
    return Findings(readout.classes_, tuple(_scene(seen, number, readout) for number in range(len(seen.pairs))))


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Verdicts over all scenes of all twins, and the figure of the first scene that is judged.

    Raises:
        AnalysisError: The readout recognises the images of no scene.
    """
    benches = [(found, scenes) for found in findings if (scenes := found.judged())]
    if not benches:
        raise AnalysisError("no scene has two images that the readout recognises at rest: measure more scenes")
    judged = [scene for _, scenes in benches for scene in scenes]
    certain = [
        (found, sure) for found, scenes in benches if (sure := [scene for scene in scenes if all(scene.certain)])
    ]
    transit_s = judged[0].transit_s
    here: dict[str, Any] = {
        "scenes": sum(len(found.scenes) for found in findings),
        "scenes_judged": len(judged),
        "judged_of_a_twin": pooled(
            (len(found.judged()) for found in findings), within=(0, max(len(found.scenes) for found in findings))
        ),
        "fewest_judged_of_a_twin": min(len(found.judged()) for found in findings),
        "twins_judged": counted((bool(found.judged()), 1) for found in findings),
        "before_right": _counted(benches, lambda found, scene: found.verdict(scene)[0]),
        "after_right": _counted(benches, lambda found, scene: found.verdict(scene)[1]),
        "scenes_right": _counted(benches, _right),
        "scenes_certain_at_rest": sum(len(scenes) for _, scenes in certain),
        "scenes_right_of_certain": _counted(certain, _right) if certain else None,
        "single_windows_right": pooled(
            (np.mean([found.share_right(scene) for scene in scenes]) for found, scenes in benches), within=SHARE
        ),
        "switch_by_correlation": _switch([[scene.crossing_s for scene in scenes] for _, scenes in benches], transit_s),
        "switch_by_class": _switch([[scene.stays_s for scene in scenes] for _, scenes in benches], transit_s),
    }
    found, shown = benches[0][0], judged[0]
    names = [f'"{label}"' for label in found.classes]
    of_pair = [names[int(np.searchsorted(found.classes, label))] for label in shown.labels]
    figure = switch_figure(
        shown.time_s,
        dict(zip(of_pair, shown.correlations, strict=True)),
        shown.probabilities,
        names,
        transit_s=shown.transit_s,
        switch_s=shown.stays_s,
    )
    caption = (
        f"One scene: correlation of each window of {settings.window * 1e9:g} ns with the first and the second image at "
        "rest, and the probability of each class. From the dotted line on the new class stays the most probable."
    )
    rejected = here["scenes"] - len(judged)
    return Conclusion(
        here,
        figures=(ExperimentFigure("switch", figure, caption),),
        notes=(
            "A scene is right if the mean probability over all windows before the mirrors leave is highest for the "
            "first class, and over all windows after they have arrived for the second.",
            f"{rejected} of {here['scenes']} scenes show an image that the readout gets wrong at rest; they are left "
            "out. At rest there is one frame of each image, noise and all: an image on the border between two classes "
            "may be taken for the right one there and for the other one on the mean. Certain at rest: both images "
            "more probable than all other classes together.",
            "A window is that of one image only if no light of the other lingers in it: windows while the mirrors move "
            f"and {settings.memory * 1e9:g} ns after are not judged.",
        ),
    )


def _readout(seen: Switching, settings: Settings) -> Pipeline:
    """Trained on all still images but those of the scenes."""
    train = ~np.isin(seen.still.groups, seen.pairs)
    interval = seen.still.sample_interval_s
    readout = softmax_readout(ports=None, window_s=settings.window, sample_interval_s=interval)
    with one_thread():
        readout.fit(seen.at_rest[train], seen.still.labels[train])
    return readout


def _scene(seen: Switching, number: int, readout: Pipeline) -> Scene:
    windows, pair, labels = seen.windows[number], seen.pairs[number], seen.labels[number]
    at_rest = np.stack([seen.at_rest[np.flatnonzero(seen.still.groups == image)[0]] for image in pair])
    probabilities = sliding_probabilities(readout, windows)
    correlations = np.stack([short_time_correlation(windows, reference) for reference in at_rest])
    resting = sliding_probabilities(readout, at_rest)
    columns = np.searchsorted(readout.classes_, labels)
    own = resting[np.arange(2), columns]
    known, sure = resting.argmax(axis=1) == columns, own > CERTAIN
    interval = seen.still.sample_interval_s
    return Scene(
        labels=(int(labels[0]), int(labels[1])),
        at_rest=(bool(known[0]), bool(known[1])),
        certain=(bool(sure[0]), bool(sure[1])),
        time_s=seen.time_s,
        old=seen.old,
        new=seen.new,
        transit_s=seen.transit_s,
        probabilities=probabilities,
        correlations=correlations,
        stays_s=switch_time(probabilities, seen.starts, new=int(columns[1]), sample_interval_s=interval),
        crossing_s=switch_time(correlations.T, seen.starts, new=1, sample_interval_s=interval),
    )


def _counted(
    benches: Sequence[tuple[Findings, Sequence[Scene]]], right: Callable[[Findings, Scene], bool]
) -> Statistic:
    """How many of the scenes are right, over benches."""
    return counted((sum(right(found, scene) for scene in scenes), len(scenes)) for found, scenes in benches)


def _right(found: Findings, scene: Scene) -> bool:
    return all(found.verdict(scene))


def _switch(benches: Sequence[Sequence[float | None]], transit_s: tuple[float, float]) -> dict[str, Any]:
    """When the switch was seen, us, and how far at most outside the time in which the mirrors move."""
    leaves_s, arrives_s = transit_s

    def off_s(time: float) -> float:
        return max(leaves_s - time, time - arrives_s, 0.0)

    seen = [[time for time in times if time is not None] for times in benches]
    everything = [time for times in seen for time in times]
    return {
        "scenes": len(everything),
        "share_within_1_us": counted(
            (sum(off_s(time) <= MOST_OFF_S for time in found), len(times))
            for found, times in zip(seen, benches, strict=True)
        ),
        "time_us": pooled((np.multiply(times, 1e6) for times in seen if times), within=NOT_NEGATIVE)
        if everything
        else None,
        "furthest_off_us": max(off_s(time) for time in everything) * 1e6 if everything else None,
        "mirrors_move_us": [leaves_s * 1e6, arrives_s * 1e6],
    }


ANALYSIS = Analysis(Settings, examine, conclude)
