"""Readouts from runs: trained on a part of the images, the rest of which is kept apart to test them."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from labctl.analysis.evaluation import window_key
from labctl.analysis.intervals import interval
from labctl.analysis.readouts import softmax_readout
from labctl.analysis.splits import OTHER_CLASSES, Split, random_splits
from labctl.analysis.threads import one_thread
from labctl.errors import AnalysisError, UsageError, writing
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.manifest import protocol_settings
from labctl.runs.read.records import Records, read_records
from labctl.runs.read.run import Run, open_run
from labctl.studies.inputs_of_runs import identical_images, source_of
from labctl.studies.masks import Masks
from labctl.studies.readout_file import load_metadata, save_model

MOST_NUMBERS = 1 << 25
"""Samples of all records that are judged at once, 134 MB; of a run with more of them evenly spread ones are."""


def train_readout(
    directory: Path,
    *,
    window_s: float,
    ports: tuple[int, ...] | None,
    seed: int,
    out: Path | None,
    tau_s: float | None = None,
    inverse_penalty: float = 1.0,
) -> dict[str, Any]:
    """Train a softmax readout on nine tenths of the images of a run and save it.

    tau_s: interval of the features, s; None: every sample. inverse_penalty: C of `SoftmaxRegression`.

    Raises:
        AnalysisError: a port or window that the run does not have, or too few images.
        UsageError: `out` is there and is no readout.
        RunError: no such run.
    """
    require_replaceable(out)
    with open_run(directory) as run:
        records, left_out = bounded_records(run)
        digest, masks, manifest = run.digest(), Masks.of(run), run.manifest
    chosen = records.ports if ports is None else ports
    pipeline = softmax_readout(
        ports=ports,
        window_s=window_s,
        sample_interval_s=records.sample_interval_s,
        tau_s=tau_s,
        recorded_ports=None if ports is None else records.ports,
        inverse_penalty=inverse_penalty,
    )
    train, test = kept_apart(records, seed)
    if np.unique(records.labels[train]).size < 2:
        raise AnalysisError(f"{directory}: all images are of one class: {OTHER_CLASSES}")
    with one_thread():
        pipeline.fit(records.traces[train], records.labels[train])
    right = pipeline.predict(records.traces[test]) == records.labels[test]
    path = out or RunPaths(directory).models / file_name(window_s, tau_s, inverse_penalty, chosen)
    metadata = {
        "readout": "softmax",
        "run": str(directory),
        "frames_sha256": digest,
        "masks": masks.model_dump(mode="json") | {"columns": [masks.columns[row] for row in pipeline[0].rows_]},
        "dataset": protocol_settings(manifest).get("dataset"),
        "inputs_source": source_of(manifest),
        "window_s": window_s,
        "ports": list(chosen),
        "tau_s": tau_s or records.sample_interval_s,
        "inverse_penalty": inverse_penalty,
        "features": int(pipeline[0].rows_.size * pipeline[0].samples_.size),
        "seed": seed,
        "training_shots": int(train.size),
        "test_shots": int(test.size),
        "left_out": left_out,
        "identical_images": identical_images(manifest),
        "training_groups": np.unique(records.groups[train]).tolist(),
        "test_groups": np.unique(records.groups[test]).tolist(),
        "accuracy": float(np.mean(right)),
        "interval": interval(int(right.sum()), right.size),
    }
    with writing(path, "name another --out"):
        path.parent.mkdir(parents=True, exist_ok=True)
    save_model(path, pipeline, metadata)
    kept = metadata.keys() - {"training_groups", "test_groups", "masks", "inputs_source"}
    return {"model": str(path)} | {key: value for key, value in metadata.items() if key in kept}


def require_replaceable(out: Path | None) -> None:
    """Require that a readout may be written to `out`: nothing is there, or an earlier readout.

    Raises:
        UsageError: something else is there.
    """
    if out is not None and out.exists():
        try:
            load_metadata(out)
        except AnalysisError:
            raise UsageError(f"--out = {out}: is there and is no readout: name another file") from None


def kept_apart(records: Records, seed: int) -> Split:
    """The shots that a readout is trained on, and those that it never sees: a tenth of the images.

    Raises:
        AnalysisError: there are too few images.
    """
    return next(iter(random_splits(records.labels, records.groups, splits=1, seed=seed)))


def file_name(window_s: float, tau_s: float | None, inverse_penalty: float, ports: tuple[int, ...]) -> str:
    """What a readout is called by; `ports` come again for every wavelength, their name once."""
    special = "" if tau_s is None else f"-every-{tau_s * 1e12:g}ps"
    special += "" if inverse_penalty == 1 else f"-C-{inverse_penalty:g}"
    return f"softmax-{window_key(window_s)}ns{special}-ports-{'-'.join(map(str, dict.fromkeys(ports)))}.h5"


def bounded_records(run: Run, kind: str = "image") -> tuple[Records, int]:
    """The shots of `kind` of a run, as many as `MOST_NUMBERS` allows, evenly spread; and how many are left out."""
    records = read_records(run, kind, most=max(1, MOST_NUMBERS // max(1, math.prod(run.frames.shape[1:]))))
    return records, int(np.count_nonzero(run.shots["kind"] == kind)) - records.labels.size
