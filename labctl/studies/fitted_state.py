"""What the fitted state of a readout must be like to be used at all, whoever made its file.

NumPy would take many a wrong array without a word: one of another length is repeated, one that is not a number makes
every prediction the same. Whatever is not sound is a `ValueError` with a few words for the one who reads the file.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from sklearn.base import BaseEstimator
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import Pipeline

from labctl.analysis.softmax import SoftmaxRegression
from labctl.analysis.windows import WindowFeatures

_LABELS = "classes_"
_ENDS = 2


def require_sound(step: Any, state: Mapping[str, str]) -> None:
    """Compare the fitted attributes of a step with their axes, and with each other.

    Args:
        step: An estimator.
        state: Axes of each of its attributes by name: "answers features". Axes of one name have one length, `features`
            that of the attribute `n_features_in_`. The axis "[outputs]" may be missing, with "features?" the attribute.

    Raises:
        ValueError: They do not fit.
    """
    lengths: dict[str, int] = {"ends": _ENDS}
    if "n_features_in_" in state:
        lengths["features"] = _whole(step, "n_features_in_")
    for name, axes in state.items():
        value = getattr(step, name)
        if isinstance(value, BaseEstimator) or (value is None and axes.endswith("?")):
            continue
        found = np.asarray(value)
        if found.dtype.kind not in ("biufU" if name == _LABELS else "biuf"):
            raise ValueError(f"{name} holds no numbers")
        if found.dtype.kind == "f" and not np.isfinite(found).all():
            raise ValueError(f"{name} holds values that are not finite")
        _require_shape(name, found.shape, axes.rstrip("?").split(), lengths)
    if isinstance(step, LogisticRegression) and lengths["answers"] != _answers(lengths["classes"]):
        raise ValueError(f"{lengths['answers']} rows of weights for {lengths['classes']} classes")
    if isinstance(step, LogisticRegression | SoftmaxRegression) and (
        lengths["classes"] == 1 or not np.array_equal(step.classes_, np.unique(step.classes_))
    ):
        raise ValueError("its classes are not in order")
    if isinstance(step, WindowFeatures):
        for name, bound in (("rows_", "ports_in_"), ("samples_", "samples_in_")):
            places = np.asarray(getattr(step, name))
            if places.dtype.kind not in "iu" or not ((places >= 0) & (places < _whole(step, bound))).all():
                raise ValueError(f"{name} are no places among {bound}")


def require_chained(pipeline: Pipeline) -> None:
    """Compare the number of features that each step takes with what the one before gives.

    Raises:
        ValueError: They differ.
    """
    given: int | None = None
    for name, step in pipeline.steps:
        if isinstance(step, WindowFeatures):
            given = len(step.rows_) * len(step.samples_)
        elif given not in (None, step.n_features_in_):
            raise ValueError(f"{name} takes {step.n_features_in_} features and is given {given}")
        else:
            given = step.n_features_in_


def _require_shape(name: str, shape: tuple[int, ...], axes: list[str], lengths: dict[str, int]) -> None:
    optional = [axis for axis in axes if axis.startswith("[")]
    kept = axes if len(shape) == len(axes) else [axis for axis in axes if axis not in optional]
    if len(shape) != len(kept):
        raise ValueError(f"{name} has {len(shape)} axes")
    for axis, length in zip(kept, shape, strict=True):
        if lengths.setdefault(axis, length) != length:
            raise ValueError(f"{name} has {length} {axis.strip('[]')}, not {lengths[axis]}")


def _answers(classes: int) -> int:
    """Rows of weights of scikit-learn's classifier: one tells two classes apart."""
    return 1 if classes == 2 else classes


def _whole(step: Any, name: str) -> int:
    value = np.asarray(getattr(step, name))
    if value.shape != () or value.dtype.kind not in "iu" or value < 1:
        raise ValueError(f"{name} is no number of things")
    return int(value)
