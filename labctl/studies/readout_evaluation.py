"""How good a readout is: tested on a run's images that it has not seen, beside its like that is trained anew."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError
from sklearn.base import clone
from sklearn.pipeline import Pipeline

from instruments.toml_files import describe
from labctl.analysis.evaluation import (
    CrossValidation,
    accuracy_against_window,
    chance_of,
    control,
    mean_and_sd,
    shuffled_labels,
    validate,
    window_key,
    windows_to_try,
)
from labctl.analysis.intervals import Verdict, interval
from labctl.analysis.readouts import softmax_classifier
from labctl.analysis.splits import SEEDS, Split, enough_splits, forward_in_time_split, own_split, random_splits
from labctl.analysis.windows import WindowFeatures
from labctl.datasets import catalogue
from labctl.errors import AnalysisError, TooFewImages, UsageError, one_line
from labctl.reports.figures.window import PAPER_CLAIM
from labctl.reports.page import Result
from labctl.reports.recognition import Confusion, recognition_report
from labctl.runs.format.manifest import protocol_settings
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS
from labctl.runs.read.records import Records
from labctl.runs.read.run import Run, open_run, refuse_file
from labctl.studies.inputs_of_runs import identical_images, identity_of, source_of
from labctl.studies.masks import Masks
from labctl.studies.readout_file import load_metadata, load_model
from labctl.studies.readout_training import bounded_records
from labctl.studies.tasks import one_by_one

CLAIMED_SOURCE, CLAIMED_CLASSES = "mnist", [0, 1, 2, 3]
"""What the paper's claim on recognition is of."""
NOT_SPLIT = "its images are too few, or of one class alone, to train others of its kind"
LONGEST_REASON = 200
"""Characters of what other people's code says that a message shows."""


class _Trained(BaseModel):
    """What a readout says about how it was trained, as far as a test of it depends on that."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    frames_sha256: str
    window_s: float = Field(gt=0)
    ports: tuple[int, ...]
    seed: int = Field(ge=0, lt=SEEDS)
    test_groups: tuple[int, ...]
    masks: Masks | None = None  # earlier readouts say nothing of them, nor of the next three
    dataset: str | None = None
    inputs_source: str | None = None
    training_groups: tuple[int, ...] | None = None

    @property
    def source(self) -> str | None:
        """What its images are known by; readouts of earlier versions say how their set was called."""
        return self.inputs_source or (None if self.dataset is None else identity_of(self.dataset))

    @classmethod
    def of(cls, model: Path) -> "_Trained":
        """What the file `model` says; AnalysisError if it does not."""
        try:
            return cls.model_validate(load_metadata(model))
        except ValidationError as error:
            raise AnalysisError(f"{model}: not a readout of a run ({describe(error)}): name another file") from None


def evaluate_readout(model: Path, directory: Path) -> dict[str, Any]:
    """Test a saved readout on a run, and the same kind of readout trained anew on parts of that run.

    Of images that are too few to train on some and test on others, or of one class, the first alone comes out.
    Random splits are as many as the number of images needs; where the run shows training and test part of a data set,
    the set's own split is one more. Only shots of images that the readout was not trained on are tested, whichever run
    showed them. Controls train on what says nothing about the labels (shuffled labels, a fixed image, darkness), on
    ports and window of this readout, and must stay at chance. Writes figures and report of the run.

    Raises:
        AnalysisError: not a readout, a run it does not fit (of another drive, bench, wavelength or sampling, or of
            records shorter than its window), or one of nothing but the images it was trained on.
        RunError: no such run.
        UsageError: a folder, such as the run, is named in the place of the readout, or a file in that of the run.
    """
    if model.is_dir():
        raise UsageError(f"{model}: is a folder: name the model file first, then the run directory")
    refuse_file(directory)
    readout, trained = load_model(model), _Trained.of(model)
    with open_run(directory) as run:
        here = Masks.of(run)
        with _used(model, directory):
            if (why := _unlike(trained, readout[0], here)) is not None:
                raise AnalysisError(f"{model}: cannot work on {directory}: {why}")
            rows = readout[0].rows_.tolist()
            if trained.masks is not None and trained.masks.columns:
                rows = [here.columns.index(one) for one in trained.masks.columns]
            try:
                readout[0].at(rows, len(here.columns), run.shape.samples)
            except AnalysisError as error:
                raise AnalysisError(f"{model}: cannot work on {directory}: {error}") from None
            ports = dict.fromkeys(here.columns[row][0] for row in readout[0].rows_)
        records, left_out = bounded_records(run)
        test = _unseen(run, records, trained)
        if not test.size:
            raise AnalysisError(
                f"{model}: was trained on every image of {directory}: test it on a run of others, as with "
                "--set image_seed=2"
            )
        splits = enough_splits(np.unique(records.groups).size)
        with _used(model, directory):
            controls = _controls(run, records, readout, splits=splits, seed=trained.seed)
        own = _own_split(run, records)
        identical = identical_images(run.manifest)
        source, shown = source_of(run.manifest), protocol_settings(run.manifest).get("dataset")
    with _used(model, directory):
        right, (random, forward, *by_set) = _judged(
            readout,
            records,
            test,
            [
                partial(random_splits, records.labels, records.groups, splits=splits, seed=trained.seed),
                lambda: [forward_in_time_split(records.groups, order=records.time_s)],
                *([] if own is None else [lambda: [own]]),
            ],
        )
        windows = (
            accuracy_against_window(
                records.traces,
                records.labels,
                records.groups,
                windows_s=_windows_to_try(records, readout[0]),
                window=readout[0],
                splits=splits,
                seed=trained.seed,
                readout=_learner(readout[1:]),
            )
            if random
            else ()
        )
    classes, window = np.unique(records.labels).tolist(), f"{window_key(trained.window_s)} ns"
    by_itself = [("the data set's own split", judged) for judged in by_set]
    anew = [(f"accuracy at {window}", random), ("forward in time", forward), *by_itself]
    ways = f"{splits} random splits with a tenth of the images to test" if random else NOT_SPLIT
    others = {"trained_on": trained.dataset or trained.source, "tested_on": shown or source}
    found: dict[str, Any] = {
        "model": str(model),
        "run": str(directory),
        "test_shots": int(test.size),
        "accuracy": float(np.mean(right)),
        "interval": interval(int(right.sum()), right.size),
        "left_out": left_out,
        "identical_images": identical,
        "other_images": None if source is None or trained.source in (None, source) else others,
        "splits": splits,
        "random_splits": mean_and_sd(random.scores) if random else None,
        "forward_in_time": float(forward.scores[0]) if forward else None,
        "own_split": float(by_set[0].scores[0]) if by_set and by_set[0] else None,
        "controls": controls,
        "classes": classes,
        "confusion": random.confusion.tolist() if random else None,
    }
    report = recognition_report(
        directory,
        title=f"Image recognition: {directory.name}",
        summary=(
            f"{records.labels.size} images on ports {', '.join(map(str, ports))}; softmax readout, "
            f"{ways}{_without(left_out)}."
        ),
        accuracies={"softmax readout": {window_key(row.window_s): mean_and_sd(row.scores) for row in windows}}
        if windows
        else {},
        results=[
            Result("this readout, unseen shots", "", "", f"{100 * found['accuracy']:.1f} %", None),
            *(
                Result(name, "", "", f"{100 * np.mean(judged.scores):.1f} %" if judged else "not judged", None)
                for name, judged in anew
            ),
            *(
                Result(f"control: {name}", "", "at chance", "not judged", None)
                if entry is None
                else Result(
                    f"control: {name}",
                    "",
                    "at chance",
                    f"{100 * entry['accuracy']:.1f} %",
                    Verdict.REACHED if entry["at_chance"] else Verdict.NOT_REACHED,
                )
                for name, entry in controls.items()
            ),
        ],
        confusions=[Confusion(window, random.confusion)] if random else [],
        classes=[str(label) for label in classes],
        chance=chance_of(records.labels),
        tau_s=readout[0].tau_s or records.sample_interval_s,
        claim=PAPER_CLAIM if source == CLAIMED_SOURCE and classes == CLAIMED_CLASSES else None,
        carried_out=one_by_one,
    )
    return found | {"report": str(report)}


def _unlike(trained: _Trained, window: WindowFeatures, here: Masks) -> str | None:
    """Why a readout cannot work on a run of the masks `here`; of an earlier one, which says less, all ports count."""
    if trained.masks is not None and ((why := trained.masks.unlike(here)) is not None or trained.masks.columns):
        return why
    its, those = tuple(window.recorded_ports or trained.ports), tuple(port for port, _ in here.columns)
    if its == those:
        return None
    known, found = (", ".join(map(str, dict.fromkeys(ports))) for ports in (its, those))
    return f"it was trained on ports {known}, and this run is of {found}: train anew"


def _windows_to_try(records: Records, window: WindowFeatures) -> list[float]:
    """Acquisition times, s, that hold a whole number of the window's own samples."""
    every = round((window.tau_s or records.sample_interval_s) / records.sample_interval_s)
    return windows_to_try(records.traces.shape[2] // every, every * records.sample_interval_s)


def _judged(
    readout: Pipeline, records: Records, test: NDArray[np.intp], ways: Iterable[Callable[[], Iterable[Split]]]
) -> tuple[NDArray[np.bool_], list[CrossValidation | None]]:
    """Which of the `test` shots a readout recognises; and its like, trained anew on each of some ways to split them.

    None for a way that the images are too few for, or of one class.
    """
    features, learner = readout[0].transform(records.traces), _learner(readout[1:])
    right = np.asarray(readout[1:].predict(features[test]) == records.labels[test])
    judged: list[CrossValidation | None] = []
    for splits in ways:
        try:
            judged.append(validate(features, records.labels, splits(), readout=learner))
        except TooFewImages:
            judged.append(None)
    return right, judged


@contextmanager
def _used(model: Path, directory: Path) -> Iterator[None]:
    """Whatever a readout that somebody made raises on a run becomes the one error; want of memory is not its fault."""
    try:
        yield
    except (AnalysisError, MemoryError):
        raise
    except HDF5_ERRORS as error:
        reason = one_line(error)[:LONGEST_REASON]
        raise AnalysisError(f"{model}: is of no use on {directory} ({reason}): train it again") from None


def _without(left_out: int) -> str:
    """What a report says of images that were left out."""
    return f"; {left_out} more images of the run, evenly spread, are left out" if left_out else ""


def _learner(readout: Pipeline) -> Pipeline | None:
    """The unfitted estimator to train anew; None, which is faster, where it is `softmax_classifier()`."""
    unfitted: Pipeline = clone(readout)
    usual = softmax_classifier()
    alike = [type(step) for _, step in unfitted.steps] == [type(step) for _, step in usual.steps] and all(
        own.get_params() == other.get_params() for (_, own), (_, other) in zip(unfitted.steps, usual.steps, strict=True)
    )
    return None if alike else unfitted


def _unseen(run: Run, records: Records, trained: _Trained) -> NDArray[np.intp]:
    """Places of the shots of images that the readout was not trained on.

    A readout that does not say which those are was trained on all but the kept ones of its own run.
    """
    if trained.training_groups is None:
        own = trained.frames_sha256 == run.digest()
        return np.flatnonzero(np.isin(records.groups, trained.test_groups) | (not own))
    same = trained.source is not None and trained.source == source_of(run.manifest)
    return np.flatnonzero(np.isin(records.groups, trained.training_groups if same else (), invert=True))


def _own_split(run: Run, records: Records) -> Split | None:
    """The split that the run's data set has itself; None where it has none, or the run shows one part only."""
    name = source_of(run.manifest)
    first_test = next((card.first_test for card in catalogue() if card.name == name), None)
    if first_test is None:
        return None
    try:
        return own_split(run.shots["dataset_index"][records.indices], first_test)
    except AnalysisError:
        return None


def _controls(
    run: Run, records: Records, readout: Pipeline, *, splits: int, seed: int
) -> dict[str, dict[str, Any] | None]:
    """Accuracy of a readout's like on what must not be recognisable, and chance; None of too few, or of one class.

    A reference or dark shot is given the label of the image shown last before it: were anything but the mirrors to
    carry the label (drift, a trace read twice), it would be found there.
    """
    shuffled = shuffled_labels(records.labels, records.groups, seed=seed)
    window, learner = readout[0], _learner(readout[1:])
    candidates = {"shuffled labels": (window.transform(records.traces), shuffled, records.groups)}
    images = np.flatnonzero(run.shots["kind"] == "image")
    for name, kind in (("fixed image", "reference"), ("dark", "dark")):
        try:
            blank, _ = bounded_records(run, kind)
        except AnalysisError:
            continue
        before = images[np.searchsorted(images, blank.indices) - 1]
        candidates[name] = (window.transform(blank.traces), run.shots["label"][before], np.arange(before.size))
    found: dict[str, dict[str, Any] | None] = {}
    for name, (features, labels, groups) in candidates.items():
        try:
            checked = control(features, labels, groups, splits=splits, seed=seed, readout=learner)
        except TooFewImages:
            found[name] = None
            continue
        found[name] = {
            "accuracy": checked.accuracy,
            "chance": checked.chance,
            "limit": checked.limit,
            "at_chance": checked.at_chance,
        }
    return found
