"""Scenes that change while they are recorded: one long record under a periodic drive, a window every period.

The same drive plays again and again, so windows a period apart see the same masks and differ only by what is on the
mirrors. A readout trained on still images reads each of them.
"""

from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from sklearn.pipeline import Pipeline
from sklearn.utils import get_tags

from labctl.analysis.threads import one_thread
from labctl.errors import AnalysisError


def periodic_windows(
    record: NDArray[Any], *, period: int, window: int, start: int = 0
) -> tuple[NDArray[Any], NDArray[np.intp]]:
    """The same window of every period of the drive.

    Args:
        record: (ports, samples).
        period: Period of the drive, samples.
        window: Length of the window, samples.
        start: First sample of the first window; as late in the period as where the readout was trained.

    Returns:
        The windows that fit whole, (n, ports, window), and the first sample of each, (n,).

    Raises:
        AnalysisError: No window fits, or a length is below one sample.
    """
    if record.ndim != 2 or min(period, window) < 1 or start < 0:
        raise AnalysisError(
            f"a record of shape {record.shape} cannot be cut into windows of {window} samples every {period} from "
            f"{start}: give (ports, samples), lengths above zero and a start in the record"
        )
    samples = record.shape[1]
    if start + window > samples:
        raise AnalysisError(f"{window} samples from {start} on do not fit into a record of {samples}: record longer")
    starts = np.arange(start, samples - window + 1, period)
    return sliding_window_view(record, window, axis=1)[:, starts].swapaxes(0, 1).copy(), starts


def short_time_correlation(windows: NDArray[Any], reference: NDArray[Any]) -> NDArray[np.float64]:
    """Pearson's correlation (n,) of each window (n, ports, window) with a reference (ports, window), ports together.

    1 for equal windows, whatever their gain and level. 0 where a window or the reference is constant.

    Raises:
        AnalysisError: The reference is not shaped like a window.
    """
    if windows.ndim != 3 or windows.shape[1:] != reference.shape:
        raise AnalysisError(
            f"windows of shape {windows.shape} and a reference of shape {reference.shape}: cut both alike"
        )
    seen = _centred(windows.reshape(len(windows), -1))
    known = _centred(reference.reshape(1, -1))[0]
    norms = np.linalg.norm(seen, axis=1) * np.linalg.norm(known)
    correlation: NDArray[np.float64] = np.divide(seen @ known, norms, out=np.zeros(len(seen)), where=norms > 0)
    return correlation


def sliding_probabilities(readout: Any, windows: NDArray[Any]) -> NDArray[np.float64]:
    """Probability of each class (n, classes) in each window (n, ports, window), in the order of `readout.classes_`.

    Args:
        readout: Fitted classifier of records cut like the windows, or of their features port by port.
        windows: (n, ports, window).
    """
    first = readout[0] if isinstance(readout, Pipeline) else readout
    takes_records = get_tags(first).input_tags.three_d_array
    with one_thread():
        return np.asarray(readout.predict_proba(windows if takes_records else windows.reshape(len(windows), -1)))


def switch_index(probabilities: NDArray[np.floating], new: int) -> int | None:
    """First window from which the class in column `new` stays the most probable to the end.

    Args:
        probabilities: (n, classes).
        new: Column of the class.

    Returns:
        Place of the window; None if another class is the most probable in the last one.
    """
    others = np.flatnonzero(np.argmax(probabilities, axis=1) != new)
    first = int(others[-1]) + 1 if others.size else 0
    return first if first < len(probabilities) else None


def switch_time(
    probabilities: NDArray[np.floating], starts: NDArray[np.integer], *, new: int, sample_interval_s: float
) -> float | None:
    """Start of the window from which the class in column `new` stays the most probable, s after the first sample.

    Args:
        probabilities: (n, classes).
        starts: (n,) first sample of each window.
        new: Column of the class.
        sample_interval_s: s.

    Returns:
        s; None if there is no such window.
    """
    index = switch_index(probabilities, new)
    return None if index is None else float(starts[index] * sample_interval_s)


def settled_windows(
    starts: NDArray[np.integer],
    *,
    window: int,
    sample_interval_s: float,
    leaves_s: float,
    arrives_s: float,
    memory_s: float,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which windows hold nothing but the light of the old image, and which nothing but that of the new one.

    Fibre, reservoir and detector remember: light is still on its way when the mirrors have long moved, so a window is
    of the new image only if it starts `memory_s` after they arrived.

    Args:
        starts: (n,) first sample of each window.
        window: Length of a window, samples.
        sample_interval_s: s.
        leaves_s: When light that left the first moving mirror reaches the detector, s after the first sample.
        arrives_s: When light that left the last mirror at rest reaches the detector first, s.
        memory_s: How long the system remembers, s.

    Returns:
        Two masks (n,): old image, new image. A window of both is in neither.

    Raises:
        AnalysisError: The mirrors arrive before they leave, or the memory is negative.
    """
    if arrives_s < leaves_s or memory_s < 0:
        raise AnalysisError(
            f"mirrors that leave at {leaves_s:g} s and arrive at {arrives_s:g} s, with a memory of {memory_s:g} s: "
            "give the times in this order and a memory of 0 or more"
        )
    begin = starts * sample_interval_s
    end = (starts + window - 1) * sample_interval_s
    return end < leaves_s, begin >= arrives_s + memory_s


def _centred(values: NDArray[Any]) -> NDArray[np.float64]:
    exact = values.astype(np.float64)
    exact -= exact.mean(axis=1, keepdims=True)
    return exact
