"""The whole job at size: acquire, train, evaluate and report digits of all ten classes, one trigger each, in bursts.

    python -m benchmarks whole_job

Needs the data set `mnist`. Each step is a process of its own: its time, and the most memory it had. Beside them the
same fits by scikit-learn's own logistic regression, and the same bytes read by h5py alone.
"""

import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import h5py
import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler
from threadpoolctl import threadpool_limits

from benchmarks.commands import Taken, labctl
from benchmarks.rows import Goal, Row, interleaved
from labctl.analysis.evaluation import validate
from labctl.analysis.splits import Split, enough_splits, random_splits
from labctl.analysis.windows import WindowFeatures
from labctl.runs.read.records import read_records
from labctl.runs.read.run import open_run

SIZES = (10_000, 60_000)
JUDGED = 10_000
"""Of a run of so many images the fits and the reading are compared with others'."""
WINDOW_S = 0.4e-9
MODEL = "models/softmax-0.4ns-ports-2-3-4-5-6.h5"
REPETITIONS = 3
MOST_MB = 1000.0
MOST_S = {"evaluate": 60.0, "report": 60.0}
MOST_WHOLE_S = 180.0
"""For the larger size."""


def job(images: int, directory: Path) -> dict[str, Taken]:
    """Every step of the job with so many images."""
    run = str(directory)
    settings = ("dataset=mnist", f"images={images}", "timing=burst")
    return {
        "run": labctl("run", "image-readout", *(word for one in settings for word in ("--set", one)), "--out", run),
        "train": labctl("train", run),
        "evaluate": labctl("evaluate", str(directory / MODEL), run),
        "report": labctl("report", run),
    }


def by_scikit_learn(features: NDArray[np.floating], labels: NDArray[np.int64], splits: list[Split]) -> None:
    """The same regressions, one after the other, on one thread."""
    with threadpool_limits(1):
        for train, test in splits:
            readout = make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000))
            readout.fit(features[train], labels[train]).predict(features[test])


def by_h5py(path: Path) -> None:
    """All frames in V, by h5py alone."""
    with h5py.File(path) as file:
        file["frames"][:] * file["scale"][:].astype(np.float32)[:, np.newaxis]


def by_labctl(directory: Path) -> None:
    """All images in V on the grid of the trigger, with labels."""
    with open_run(directory) as run:
        read_records(run)


def compared(directory: Path) -> Iterator[Row]:
    """Fits and reading of one run beside those of others."""
    with open_run(directory) as run:
        records = read_records(run)
    window = WindowFeatures(window_s=WINDOW_S, sample_interval_s=records.sample_interval_s)
    features, count = window.fit_transform(records.traces), enough_splits(records.labels.size)
    splits = list(random_splits(records.labels, records.groups, splits=count, seed=1))
    ours, plain = interleaved(
        partial(validate, features, records.labels, splits),
        partial(by_scikit_learn, features, records.labels, splits),
        repetitions=REPETITIONS,
    )
    yield Row(
        f"{count} splits of {records.labels.size} images, {features.shape[1]} features",
        ours.processor_s,
        "s of processor",
        against="scikit-learn's logistic regression",
        reference=plain.processor_s,
        goal=Goal(most=1.0),
    )
    ours, plain = interleaved(
        partial(by_labctl, directory), partial(by_h5py, directory / "data.h5"), repetitions=REPETITIONS
    )
    yield Row(
        f"records of {records.labels.size} images read, moved to the trigger's grid",
        ours.processor_s,
        "s of processor",
        against="h5py alone, as recorded",
        reference=plain.processor_s,
    )


def rows() -> Iterator[Row]:
    """Time and peak of memory of every step, and of the whole job, for each size."""
    with tempfile.TemporaryDirectory() as folder:
        for images in SIZES:
            directory = Path(folder) / str(images)
            steps = job(images, directory)
            for name, one in steps.items():
                goal = Goal(most=MOST_S[name], of="figure") if name in MOST_S else None
                yield Row(f"{name}, {images} images", one.wall_s, "s", one.processor_s, goal=goal)
                most = Goal(most=MOST_MB, of="figure")
                yield Row(f"{name}, {images} images: most memory", one.peak_mb, "MB", goal=most)
            yield Row(
                f"all of it, {images} images",
                sum(one.wall_s for one in steps.values()),
                "s",
                sum(one.processor_s for one in steps.values()),
                goal=Goal(most=MOST_WHOLE_S, of="figure"),
            )
            if images == JUDGED:
                yield from compared(directory)
