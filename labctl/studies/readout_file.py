"""Trained readouts as files: arrays and JSON in HDF5, readable by anything that reads HDF5 and never executed.

Attributes of the file: `format` ("labctl-readout"), `format_version`, `metadata` (JSON object), `steps` (JSON list of
the steps' names in order), `sha256` over all the rest, which earlier files do not have. One group a step, with
attributes `estimator` (class name) and `parameters` (JSON object of the settings that differ from the class's defaults)
and one data set for each fitted array. Where an estimator contains another, that is a group in its group: a pipeline
with attribute `steps` like the file itself, or an estimator.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator
from sklearn.linear_model import LogisticRegression, Ridge, RidgeCV
from sklearn.pipeline import Pipeline
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted

from labctl.analysis.anomaly import CovarianceScore, NormalityScore
from labctl.analysis.reconstruction import KernelReconstruction, LinearReconstruction
from labctl.analysis.softmax import SoftmaxRegression
from labctl.analysis.windows import WindowFeatures
from labctl.errors import AnalysisError
from labctl.runs.format.durable import not_made, replace_file
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, LIBVER, attribute, check_plain, set_text, walked
from labctl.runs.format.readout import FORMAT, LARGEST, metadata_in
from labctl.studies.fitted_state import require_chained, require_sound

FORMAT_VERSION = "1.1"
DIGEST = "sha256"

FITTED: Mapping[str, tuple[type, Mapping[str, str]]] = {
    "WindowFeatures": (WindowFeatures, {"rows_": "rows", "samples_": "times", "ports_in_": "", "samples_in_": ""}),
    "StandardScaler": (
        StandardScaler,
        {
            "mean_": "features?",
            "var_": "features?",
            "scale_": "features?",
            "n_samples_seen_": "",
            "n_features_in_": "",
        },
    ),
    "LogisticRegression": (
        LogisticRegression,
        {
            "classes_": "classes",
            "coef_": "answers features",
            "intercept_": "answers",
            "n_iter_": "fits",
            "n_features_in_": "",
        },
    ),
    "SoftmaxRegression": (
        SoftmaxRegression,
        {
            "classes_": "classes",
            "coef_": "classes features",
            "intercept_": "classes",
            "n_iter_": "",
            "n_features_in_": "",
        },
    ),
    "Ridge": (Ridge, {"coef_": "[outputs] features", "intercept_": "[outputs]", "n_features_in_": ""}),
    "RidgeCV": (
        RidgeCV,
        {
            "alpha_": "",
            "best_score_": "",
            "coef_": "[outputs] features",
            "intercept_": "[outputs]",
            "n_features_in_": "",
        },
    ),
    "NormalityScore": (NormalityScore, {"mean_": "features", "coef_": "features", "n_features_in_": ""}),
    "CovarianceScore": (
        CovarianceScore,
        {
            "mean_": "features",
            "scale_": "features",
            "precision_": "features features",
            "shrinkage_": "",
            "n_features_in_": "",
        },
    ),
    "LinearReconstruction": (
        LinearReconstruction,
        {"pipeline_": "", "alpha_": "", "range_": "ends", "n_features_in_": ""},
    ),
    "KernelReconstruction": (
        KernelReconstruction,
        {
            "gamma_": "",
            "alphas_": "components",
            "dual_coef_": "shots pixels",
            "mean_": "pixels",
            "range_": "ends",
            "n_features_in_": "",
            "_scaler": "",
            "_shots": "shots features",
            "_column_means": "shots",
            "_pixels": "axes",
        },
    ),
}
"""What may be in a file: class name -> class, and the fitted attributes that make up its state with their axes.

Equal names are equal lengths; see `fitted_state.require_sound`.
"""


def save_model(path: Path, pipeline: Pipeline, metadata: Mapping[str, Any]) -> None:
    """Write a fitted pipeline of `FITTED` classes; the file appears complete or not at all.

    Args:
        path: File to write; an existing one is replaced.
        pipeline: Fitted pipeline.
        metadata: Anything JSON can hold: run, protocol, window, accuracy, seeds, versions.

    Raises:
        AnalysisError: A step is of another class, or not fitted to plain arrays.
        RunError: The file cannot be written.
        sklearn.exceptions.NotFittedError: The pipeline is not fitted.
    """
    _require_savable(pipeline)
    image = BytesIO()
    with h5py.File(image, "w", libver=LIBVER) as file:
        set_text(file, "format", FORMAT)
        set_text(file, "format_version", FORMAT_VERSION)
        set_text(file, "metadata", _json(dict(metadata)))
        _write(file, pipeline)
        set_text(file, DIGEST, _content(file))
    replace_file(path, image.getvalue(), not_made)


def load_model(path: Path) -> Pipeline:
    """The fitted pipeline in a file that `save_model` wrote; it predicts exactly what the saved one did.

    Raises:
        AnalysisError: The file is not a readout, is newer than this program, or holds an unknown class.
    """
    with _open(path) as file:
        pipeline = _read(file, path)
        if not isinstance(pipeline, Pipeline) or not pipeline.steps:
            raise ValueError("it holds no steps")
        require_chained(pipeline)
        _require_unchanged(file)
        return pipeline


def load_metadata(path: Path) -> dict[str, Any]:
    """The metadata saved with a readout.

    Raises:
        AnalysisError: The file is not a readout, or is newer than this program.
    """
    with _open(path) as file:
        metadata = metadata_in(file)
        _require_unchanged(file)
        return metadata


@contextmanager
def _open(path: Path) -> Iterator[h5py.File]:
    """A readout's file; whatever reading raises on one that somebody changed becomes the one error."""
    try:
        file = walked(path)
    except OSError as error:
        why = f" ({error.strerror})" if error.strerror else ""
        raise AnalysisError(f"{path}: cannot be read as HDF5{why}: name a file that 'labctl train' wrote") from error
    with file:
        try:
            check_plain(file, LARGEST)
            _require_readable(file, path)
            yield file
        except AnalysisError:
            raise
        except HDF5_ERRORS as error:
            reason = " ".join(str(error).split())[:300]
            raise AnalysisError(f"{path}: a damaged readout ({reason}): name another file, or train it again") from None


def _require_readable(file: h5py.File, path: Path) -> None:
    if "format" not in file.attrs or attribute(file, "format") != FORMAT:
        raise AnalysisError(f"{path}: an HDF5 file, but not a readout: name a file that 'labctl train' wrote")
    version = str(attribute(file, "format_version"))[:20]
    if _numbers(version) > _numbers(FORMAT_VERSION):
        raise AnalysisError(
            f"{path}: format version {version!r}, this labctl reads up to {FORMAT_VERSION}: update labctl"
        )


def _require_unchanged(file: h5py.File) -> None:
    if DIGEST in file.attrs and attribute(file, DIGEST) != _content(file):
        raise ValueError("its sha256 is not that of what it holds")


def _content(group: h5py.Group) -> str:
    """SHA-256 over the names, attributes and arrays in a file or group, in hex; how HDF5 stores them is not in it."""
    digest = hashlib.sha256()
    attributes = {name: attribute(group, name) for name in group.attrs if name != DIGEST}
    digest.update(json.dumps(attributes, sort_keys=True).encode())
    for name in sorted(group):
        found = group[name]
        digest.update(f" {name} ".encode())
        if isinstance(found, h5py.Group):
            digest.update(_content(found).encode())
        else:
            values = np.ascontiguousarray(found[()])
            digest.update(f"{values.dtype.str} {values.shape} ".encode() + values.tobytes())
    return digest.hexdigest()


def _numbers(version: str) -> tuple[float, ...]:
    """Version as numbers to compare; a part that is none counts as newer than everything."""
    return tuple(int(part) if part.isdecimal() else float("inf") for part in version.split("."))


def _require_savable(estimator: Any) -> None:
    if isinstance(estimator, Pipeline):
        for _, step in estimator.steps:
            _require_savable(step)
        return
    if type(estimator).__name__ not in FITTED:
        raise AnalysisError(
            f"a step of class {type(estimator).__name__} cannot be saved: only {', '.join(FITTED)} have a file format"
        )
    check_is_fitted(estimator)


def _write(group: h5py.Group, estimator: Any) -> None:
    if isinstance(estimator, Pipeline):
        set_text(group, "steps", json.dumps([name for name, _ in estimator.steps]))
        for name, step in estimator.steps:
            _write(group.create_group(name), step)
        return
    set_text(group, "estimator", type(estimator).__name__)
    set_text(group, "parameters", _json(_changed_parameters(estimator)))
    for name in FITTED[type(estimator).__name__][1]:
        value = getattr(estimator, name)
        if isinstance(value, BaseEstimator):
            _write(group.create_group(name), value)
        elif value is not None:
            group.create_dataset(name, data=_storable(np.asarray(value)))


def _read(group: h5py.Group, path: Path) -> Any:
    if "steps" in group.attrs:
        return Pipeline([(name, _read(group[name], path)) for name in json.loads(attribute(group, "steps"))])
    name = str(attribute(group, "estimator"))
    if name not in FITTED:
        raise AnalysisError(f"{path}: holds a step of unknown class '{name}': this labctl knows {', '.join(FITTED)}")
    estimator, attributes = FITTED[name]
    parameters = {
        key: tuple(value) if isinstance(value, list) else value
        for key, value in json.loads(attribute(group, "parameters")).items()
    }
    step = estimator(**parameters)
    for fitted in attributes:
        stored = group.get(fitted)
        if isinstance(stored, h5py.Group):
            setattr(step, fitted, _read(stored, path))
        else:
            setattr(step, fitted, None if stored is None else _restored(stored))
    require_sound(step, attributes)
    return step


def _changed_parameters(step: Any) -> dict[str, Any]:
    """Settings that differ from the class's defaults: what other versions of scikit-learn understand too."""
    defaults = type(step)().get_params()
    return {key: value for key, value in step.get_params(deep=False).items() if _json(value) != _json(defaults[key])}


def _json(value: Any) -> str:
    """JSON with sorted keys; NumPy numbers and arrays become plain ones."""

    def plain(entry: object) -> Any:
        if isinstance(entry, np.ndarray | np.generic):
            return entry.tolist()
        if isinstance(entry, Sequence):
            return list(entry)
        raise AnalysisError(f"{entry!r} cannot be saved with a readout: use numbers, text, lists and mappings")

    return json.dumps(value, sort_keys=True, default=plain)


def _storable(value: NDArray[Any]) -> Any:
    """Text as HDF5 strings of fixed length; numbers as they are."""
    if value.dtype.kind in "UO" and all(isinstance(entry, str) for entry in value.flat):
        stored = np.strings.encode(value.astype(np.str_), "utf-8")
        return stored.astype(h5py.string_dtype("utf-8", max(1, stored.dtype.itemsize)))
    if value.dtype.kind not in "biuf":
        raise AnalysisError(f"fitted values of type {value.dtype} cannot be saved: use numbers or text as class labels")
    return value


def _restored(dataset: h5py.Dataset) -> Any:
    if h5py.check_string_dtype(dataset.dtype) is not None:
        return dataset.asstr()[...].astype(np.str_)
    value = dataset[()]
    return value.item() if np.ndim(value) == 0 else value
