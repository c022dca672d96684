"""Images without training images: masks from random patterns beside a reference, and a film of 10 ns a frame.

Two readings of an image are judged. In one frame the reference is on and I(V + R) - I(R) is read, the image's own light
with it: that is what a camera of one frame a window has. Two frames, with and without the reference, take the image's
own light off; then what is read is linear in the image, see `labctl.analysis.ghost_imaging`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, PositiveInt

from instruments.units import Seconds
from labctl.analysis.dynamic import periodic_windows, settled_windows
from labctl.analysis.evaluation import window_key
from labctl.analysis.ghost_imaging import GhostImaging
from labctl.analysis.intervals import NOT_NEGATIVE, pooled
from labctl.analysis.regression import rmse
from labctl.analysis.windows import sample_count
from labctl.errors import AnalysisError
from labctl.reports.canvas import Level, Series
from labctl.reports.experiments import ExperimentFigure
from labctl.reports.figures.images import ImageRow, filmstrip_figure, image_rows_figure
from labctl.reports.figures.window import rmse_figure
from labctl.runs.read.records import Records
from labctl.runs.read.run import open_run
from labctl.studies.paper.analyses import Analysis, AnalysisSettings, Conclusion
from labctl.studies.paper.film import Film, film_results
from labctl.studies.paper.switching import SwitchSettings
from labctl.studies.paper.twin_runs import TAU_S, TwinRuns
from protocols import ghost_imaging as acquisition
from protocols.dynamic_scene import DynamicScene
from protocols.reference_picture import field_of

ONE, TWO = "one_frame", "two_frames"
NAMES = {ONE: "one frame", TWO: "two frames"}


class SetSettings(BaseModel):
    """A run of one kind of image; `key` names it in the results, `label` in the figures."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    label: str
    run: str


class FilmSettings(SwitchSettings):
    """The scene that is filmed: the first one of a run, an image from every window.

    Attributes:
        run: Name of the run of scenes.
        calibration: Name of the run whose random patterns give the masks.
        times: Which windows are shown: the last that starts by each of these times.
    """

    run: str
    calibration: str
    times: Annotated[tuple[Seconds, ...], Field(min_length=1)]

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the film is made of."""
        return (self.run, self.calibration)


class Settings(AnalysisSettings):
    """Settings of the analysis.

    Attributes:
        sets: The runs.
        windows: Acquisition times T_N of a frame, rising.
        wavelengths: How many of a run's wavelengths, the first ones; the last number is the one of film and figures.
        examples: How many images of each run are shown.
        film: The scene that is filmed; None = none.
    """

    sets: Annotated[tuple[SetSettings, ...], Field(min_length=1)]
    windows: Annotated[tuple[Seconds, ...], Field(min_length=1)]
    wavelengths: Annotated[tuple[PositiveInt, ...], Field(min_length=1)]
    examples: PositiveInt = 8
    film: FilmSettings | None = None

    @property
    def reads(self) -> tuple[str, ...]:
        """Names of the runs that the analysis reads."""
        return (*(one.run for one in self.sets), *(() if self.film is None else self.film.reads))


@dataclass(frozen=True)
class Imaged:
    """One run on one twin.

    Attributes:
        errors: RMSE on all images, by reading, number of wavelengths (text) and T_N (text, ns).
        patterns: The same on the random patterns that were held out.
        constant: RMSE of the best constant image, the mean of those that are judged.
        originals: (n, rows, columns) some of the images.
        examples: The same in the longest window: by reading and number of wavelengths.
    """

    errors: dict[str, dict[str, dict[str, float]]]
    patterns: dict[str, dict[str, dict[str, float]]]
    constant: float
    originals: NDArray[np.float64]
    examples: dict[tuple[str, str], NDArray[np.float64]]


@dataclass(frozen=True)
class Findings:
    """What one twin shows: its runs by key, and its film."""

    sets: dict[str, Imaged]
    film: Film | None


@dataclass(frozen=True)
class Read:
    """What was seen of pictures in the order of their groups: volts (n, ports, samples) by reading."""

    groups: NDArray[np.int64]
    volts: dict[str, NDArray[np.floating]]


def examine(twin: TwinRuns, settings: Settings) -> Findings:
    """Calibrate on the random patterns of every run, and look at its images and the scene through the masks.

    Raises:
        AnalysisError: A run is not of ghost imaging, lacks a picture, or is shorter than a window.
    """
    sets = {one.key: _imaged(twin, one.run, settings) for one in settings.sets}
    film = None if settings.film is None else _film(twin, settings.film, settings.wavelengths[-1])
    return Findings(sets, film)


def conclude(findings: Sequence[Findings], settings: Settings) -> Conclusion:
    """Pool all twins; examples and film are of the first."""
    here: dict[str, Any] = {}
    baseline: dict[str, Any] = {}
    figures = []
    for one in settings.sets:
        twins = [found.sets[one.key] for found in findings]
        here[one.key] = _pooled([twin.errors for twin in twins]) | {
            "patterns": _pooled([twin.patterns for twin in twins])
        }
        baseline[one.key] = {"constant": pooled((twin.constant for twin in twins), within=NOT_NEGATIVE)}
        window = window_key(settings.windows[-1])
        rows = [ImageRow("original", twins[0].originals)]
        for (reading, count), images in twins[0].examples.items():
            error = here[one.key][reading][count][window]["mean"]
            label = f"{NAMES[reading]} of {float(window):g} ns\n{_wavelengths(count)}, RMSE {error:.3f}"
            rows.append(ImageRow(label, images))
        figures.append(
            ExperimentFigure(
                f"images-{one.key}",
                image_rows_figure(rows),
                f"{one.label.capitalize()} of the first twin as the mirrors showed them, and as they come back. No "
                "image was used to find the masks or to choose anything. The RMSE is that of all images and twins.",
            )
        )
    if len(settings.windows) > 1:
        figures += [_errors(here[one.key], baseline[one.key], one) for one in settings.sets]
    films = [found.film for found in findings if found.film is not None]
    if films:
        here["film"] = film_results(films) | {"frames_per_second": 1 / _interval_s(films[0])}
        figures.append(_strip(films[0]))
    notes = (
        "RMSE over all pixels of the field, pixels 0 or 1, against the image that was shown. `patterns` is the same on "
        "the random patterns that were held out, which chose penalty and strength.",
        "One frame: with the reference on, the reference alone taken off. Two frames: with it and without, twice the "
        "time. The wavelengths are measured one after the other here; at once they need a receiver each.",
    )
    return Conclusion(here, baseline, tuple(figures), notes)


ANALYSIS = Analysis(Settings, examine, conclude)


def _imaged(twin: TwinRuns, run: str, settings: Settings) -> Imaged:
    known = _patterns(twin, run)
    errors: dict[str, dict[str, dict[str, float]]] = {reading: {} for reading in NAMES}
    patterns: dict[str, dict[str, dict[str, float]]] = {reading: {} for reading in NAMES}
    examples: dict[tuple[str, str], NDArray[np.float64]] = {}
    for count in settings.wavelengths:
        calibration, unseen = _read(twin, run, "pattern", count), _read(twin, run, "image", count)
        images = field_of(twin.images_at(run, unseen.groups)).astype(np.float64)
        for reading in NAMES:
            of_images, of_patterns = {}, {}
            for window_s in settings.windows:
                imaging = _calibrated(known, calibration, reading, window_s)
                found = imaging.predict(_features(unseen.volts[reading], window_s))
                of_images[window_key(window_s)] = rmse(images, found)
                of_patterns[window_key(window_s)] = imaging.pattern_rmse_
            errors[reading][str(count)], patterns[reading][str(count)] = of_images, of_patterns
            examples[reading, str(count)] = found[: settings.examples]
    constant = rmse(images, np.broadcast_to(images.mean(axis=0), images.shape))
    return Imaged(errors, patterns, constant, images[: settings.examples], examples)


def _read(twin: TwinRuns, run: str, kind: str, wavelengths: int) -> Read:
    """The beats of pictures of `kind` with the reference, by either reading."""
    beside, alone, reference, dark = (
        twin.records(run, name, wavelengths=wavelengths) for name in (kind, f"{kind}-alone", "reference", "dark")
    )
    order, partners = np.argsort(beside.groups), np.argsort(alone.groups)
    if not np.array_equal(beside.groups[order], alone.groups[partners]):
        raise AnalysisError(f"runs.{run}: not every {kind} was measured with and without the reference: resume the run")
    one = beside.traces[order] - reference.traces.mean(axis=0)
    two = one - (alone.traces[partners] - dark.traces.mean(axis=0))
    return Read(beside.groups[order], {ONE: one, TWO: two})


def _patterns(twin: TwinRuns, run: str) -> NDArray[np.bool_]:
    """The random patterns that a run showed, by their number."""
    protocol = twin.protocols[run]
    if not isinstance(protocol, acquisition.GhostImaging):
        raise AnalysisError(
            f"runs.{run}: {protocol.name} shows no random patterns: use {acquisition.GhostImaging.name}"
        )
    return protocol.patterns_of(twin.images(run))


def _calibrated(patterns: NDArray[np.bool_], seen: Read, reading: str, window_s: float) -> GhostImaging:
    return GhostImaging().fit(_features(seen.volts[reading], window_s), patterns[seen.groups])


def _features(volts: NDArray[np.floating], window_s: float) -> NDArray[np.floating]:
    """The samples (n, ports samples) of the first `window_s` of records (n, ports, samples)."""
    samples = sample_count(window_s, TAU_S)
    if samples > volts.shape[-1]:
        raise AnalysisError(f"{samples} samples do not fit into a record of {volts.shape[-1]}: measure a longer window")
    return volts[..., :samples].reshape(len(volts), -1)


def _film(twin: TwinRuns, settings: FilmSettings, wavelengths: int) -> Film:
    """Read every window of the first scene through the masks, one frame each."""
    protocol = twin.protocols[settings.run]
    if not isinstance(protocol, DynamicScene):
        raise AnalysisError(f"runs.{settings.run}: {protocol.name} switches no images: use {DynamicScene.name}")
    run = settings.calibration
    imaging = _calibrated(_patterns(twin, run), _read(twin, run, "pattern", wavelengths), ONE, settings.window)
    scene: Records = twin.records(settings.run, "scene", wavelengths=wavelengths)
    reference = twin.records(run, "reference", wavelengths=wavelengths).traces.mean(axis=0)
    interval = scene.sample_interval_s
    window = sample_count(settings.window, interval)
    windows, starts = periodic_windows(scene.traces[0], period=window, window=window)
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
    with open_run(twin.runs[settings.run]) as stored:
        shot = stored.shots[scene.indices[0]]
        pair = twin.images_at(settings.run, [shot["dataset_index"], shot["next_dataset_index"]])
    time_s = np.asarray(starts * interval, np.float64)
    return Film(
        time_s=time_s,
        shown=np.searchsorted(time_s, np.array(settings.times) + interval / 2).clip(min=1) - 1,
        old=old,
        new=new,
        transit_s=(leaves_s, arrives_s),
        pair=field_of(pair).astype(np.float64),
        frames={ONE: imaging.predict(_features(windows - reference[:, :window], settings.window))},
    )


def _pooled(twins: Sequence[Any]) -> Any:
    """Every figure of equal trees, one a twin, pooled."""
    if isinstance(twins[0], dict):
        return {key: _pooled([twin[key] for twin in twins]) for key in twins[0]}
    return pooled(twins, within=NOT_NEGATIVE)


def _wavelengths(count: str) -> str:
    return "1 wavelength" if count == "1" else f"{count} wavelengths"


def _errors(here: dict[str, Any], baseline: dict[str, Any], one: SetSettings) -> ExperimentFigure:
    """Error against the time of a frame."""
    levels = [Level("best constant image", baseline["constant"]["mean"])]
    return ExperimentFigure(
        f"rmse-{one.key}",
        rmse_figure(list(_curves(here)), tau_s=TAU_S, levels=levels),
        f"Error of {one.label} against the time of a frame; mean and standard deviation over twins.",
    )


def _curves(here: dict[str, Any]) -> Iterator[Series]:
    for reading, name in NAMES.items():
        for count, results in here[reading].items():
            yield Series.of(f"{name}, {_wavelengths(count)}", results, unit=1e-9)


def _interval_s(film: Film) -> float:
    return float(film.time_s[1] - film.time_s[0])


def _strip(film: Film) -> ExperimentFigure:
    """What was on the mirrors, and the frames, at some times around the switch."""
    times = film.time_s[film.shown]
    leaves_s, arrives_s = film.transit_s
    on_mirrors = np.where((times > leaves_s)[:, np.newaxis, np.newaxis], film.pair[1], film.pair[0])
    on_mirrors[(times > leaves_s) & (times < arrives_s)] = film.pair.mean(axis=0)
    strips = {"on the mirrors": on_mirrors, "frame": film.frames[ONE][film.shown]}
    interval_s = _interval_s(film)
    return ExperimentFigure(
        "film",
        filmstrip_figure(strips, list(times), transit_s=film.transit_s),
        f"Frames of {1e9 * interval_s:g} ns, some of {film.time_s.size} that follow each other without a gap, "
        f"{1e-6 / interval_s:g} million a second: a scene of the first twin. Masks are of random patterns, no image "
        "was learnt. Grey on the mirrors: pixels that are changing.",
    )
