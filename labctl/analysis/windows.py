"""From oscilloscope records to features: the window and its sampling grid.

Records are arrays (shots, ports, samples), codes or volts. A window T_N sampled every tau_s on M ports gives M N
features, N = T_N / tau_s.
"""

import math
from collections.abc import Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, TransformerMixin
from sklearn.utils import Tags
from sklearn.utils.validation import check_is_fitted

from labctl.errors import AnalysisError

GRID_TOLERANCE = 0.01
"""A window may miss the sampling grid by this part of a sample: text such as "0.56 ns" is never exact in binary."""
WAVELENGTH_TOLERANCE_NM = 1e-4
"""Wavelengths closer than this are one; a tenth of the finest step of the laser."""


def sample_count(window_s: float, tau_s: float) -> int:
    """Number of samples N = T_N / tau_s of a window.

    Raises:
        AnalysisError: The window is shorter than one sample or not a whole number of them, or has no end.

    Example:
        >>> from labctl.analysis.windows import sample_count
        >>> sample_count(0.4e-9, 40e-12)
        10
        >>> sample_count(0.41e-9, 40e-12)
        Traceback (most recent call last):
        labctl.errors.AnalysisError: a window of 0.41 ns is not a whole number of 0.04 ns samples: ...
    """
    if not (window_s > 0 and tau_s > 0):
        raise AnalysisError(f"a window of {window_s:g} s sampled every {tau_s:g} s is empty: both must be above zero")
    if math.isinf(ratio := window_s / tau_s):
        raise AnalysisError(f"a window of {window_s:g} s sampled every {tau_s:g} s has no end: use a shorter one")
    count = round(ratio)
    if count < 1 or abs(ratio - count) > GRID_TOLERANCE:
        near = (number for number in (int(ratio), int(ratio) + 1) if number)
        raise AnalysisError(
            f"a window of {window_s * 1e9:g} ns is not a whole number of {tau_s * 1e9:g} ns samples: "
            f"use {' or '.join(f'{number * tau_s * 1e9:g} ns' for number in near)}"
        )
    return count


def compressive_ratio(window_s: float, tau_s: float, pixels: int = 28 * 28) -> float:
    """C = N / pixels: samples of one waveform for each pixel of the image."""
    return sample_count(window_s, tau_s) / pixels


def wavelength_rows(wavelengths_nm: Sequence[float], row_wavelengths_nm: ArrayLike) -> NDArray[np.intp]:
    """Which entries of the records' second axis were measured at one of some wavelengths.

    Where a run measures each port at several wavelengths, its records hold the ports once for each of them, and each is
    a column of features like any other: `records[:, wavelength_rows(...)]` keeps some of the wavelengths.

    Args:
        wavelengths_nm: Wavelengths to keep.
        row_wavelengths_nm: Wavelength of each entry of the second axis.

    Returns:
        Entries in the order of `wavelengths_nm`, and at each wavelength in the order of the records.

    Raises:
        AnalysisError: Nothing was measured at one of the wavelengths.
    """
    recorded = np.asarray(row_wavelengths_nm, np.float64)
    rows = []
    for wavelength in wavelengths_nm:
        found = np.flatnonzero(np.abs(recorded - wavelength) < WAVELENGTH_TOLERANCE_NM)
        if not found.size:
            known = ", ".join(f"{value:.8g}" for value in np.unique(recorded))
            raise AnalysisError(f"nothing was measured at {wavelength:.8g} nm: choose from {known} nm")
        rows.append(found)
    return np.concatenate(rows, dtype=np.intp) if rows else np.zeros(0, np.intp)


class WindowFeatures(TransformerMixin, BaseEstimator):  # type: ignore[misc]  # scikit-learn ships no types
    """The samples of a window on some ports as one row of features a shot.

    Transforms (shots, ports, samples) into (shots, M N), port by port. The window's first sample is the record's sample
    nearest to `start_s`; where fractions of a sample matter, resample the records first.

    Args:
        ports: Ports to use, in this order; None = every entry of the records' second axis. A port that was recorded
            more than once, at several wavelengths, is used with all its entries.
        window_s: Acquisition time T_N, s.
        sample_interval_s: Sample interval of the records, s.
        start_s: Start of the window after the record's first sample, s.
        tau_s: Interval of the features, s, a whole number of sample intervals; None = every sample.
        recorded_ports: Port of each entry of the records' second axis; None = the records hold `ports`, in that order.

    Attributes:
        rows_: (M,) which entries of the second axis are used.
        samples_: (N,) which samples are used.
        ports_in_: Ports in the records.
        samples_in_: Samples in the records.

    Example:
        >>> import numpy as np
        >>> from labctl.analysis.windows import WindowFeatures
        >>> records = np.zeros((900, 5, 50), np.float32)  # 2 ns on ports 2 to 6
        >>> window = WindowFeatures(ports=[2, 3], window_s=0.4e-9, recorded_ports=[2, 3, 4, 5, 6])
        >>> window.fit_transform(records).shape
        (900, 20)
    """

    def __init__(
        self,
        ports: Sequence[int] | None = None,
        window_s: float = 0.4e-9,
        sample_interval_s: float = 40e-12,
        start_s: float = 0.0,
        tau_s: float | None = None,
        recorded_ports: Sequence[int] | None = None,
    ) -> None:
        self.ports = ports
        self.window_s = window_s
        self.sample_interval_s = sample_interval_s
        self.start_s = start_s
        self.tau_s = tau_s
        self.recorded_ports = recorded_ports

    def fit(self, X: ArrayLike, y: object = None) -> Self:  # noqa: N803  # scikit-learn's own name
        """Work out which ports and samples the window takes from records shaped like `X`.

        Raises:
            AnalysisError: A port is not in the records, or the window does not fit into them.
        """
        _, ports, samples = _three_axes(np.asarray(X))
        self.rows_ = self._rows(ports)
        self.samples_ = self._samples(samples)
        self.ports_in_ = ports
        self.samples_in_ = samples
        return self

    def transform(self, X: ArrayLike) -> NDArray[np.floating]:  # noqa: N803
        """Features (shots, M N) of records (shots, ports, samples): float64 for float64 records, else float32.

        Raises:
            AnalysisError: The records are not shaped like those of `fit`, or hold values that are not finite.
        """
        check_is_fitted(self)
        records = np.asarray(X)
        shots, ports, samples = _three_axes(records)
        if (ports, samples) != (self.ports_in_, self.samples_in_):
            raise AnalysisError(
                f"records of {ports} ports x {samples} samples, but this window was fitted on "
                f"{self.ports_in_} x {self.samples_in_}: cut the records alike"
            )
        chosen = records[:, self.rows_[:, np.newaxis], self.samples_]
        features = as_float(chosen.reshape(shots, -1))
        if not np.isfinite(features).all():
            raise AnalysisError("the records hold values that are not finite: leave the broken shots out")
        return features

    def at(self, rows: Sequence[int], ports: int, samples: int) -> Self:
        """Take the same columns, in their order, from other `rows` of records of so many `ports` and `samples`.

        Returns:
            Itself.

        Raises:
            AnalysisError: The records end before the window does.
        """
        needed = int(self.samples_.max()) + 1
        if needed > samples:
            here, there = (f"{1e9 * count * self.sample_interval_s:g} ns" for count in (needed, samples))
            raise AnalysisError(
                f"its window needs {here} records, and these have {there}: record longer, or train anew"
            )
        self.set_params(ports=rows, recorded_ports=range(ports))
        self.rows_, self.ports_in_, self.samples_in_ = np.asarray(rows, np.intp), ports, samples
        return self

    def get_feature_names_out(self, input_features: object = None) -> NDArray[np.object_]:
        """Name of each feature: port and time after the start of the window."""
        check_is_fitted(self)
        known = self.recorded_ports if self.recorded_ports is not None else self.ports
        recorded = known if known is not None else range(self.ports_in_)
        names = [recorded[row] for row in self.rows_]
        times = (self.samples_ - self.samples_[0]) * self.sample_interval_s * 1e9
        return np.array([f"port {port}, {time:.3f} ns" for port in names for time in times], dtype=object)

    def __sklearn_tags__(self) -> Tags:
        tags = super().__sklearn_tags__()
        tags.input_tags.two_d_array = False
        tags.input_tags.three_d_array = True
        return tags

    def _rows(self, count: int) -> NDArray[np.intp]:
        recorded = self.recorded_ports if self.recorded_ports is not None else self.ports
        if recorded is None:
            return np.arange(count)
        if len(recorded) != count:
            raise AnalysisError(
                f"the records hold {count} ports, but {len(recorded)} are named {tuple(recorded)}: give "
                "recorded_ports, the port of each entry of the records' second axis"
            )
        if self.ports is None or self.recorded_ports is None:
            return np.arange(count)
        if not len(self.ports):
            raise AnalysisError(f"no port is chosen: choose from {tuple(recorded)}")
        if missing := [port for port in self.ports if port not in recorded]:
            raise AnalysisError(f"ports {missing} were not recorded: choose from {tuple(recorded)}")
        return np.concatenate([np.flatnonzero(np.asarray(recorded) == port) for port in self.ports], dtype=np.intp)

    def _samples(self, recorded: int) -> NDArray[np.intp]:
        tau_s = self.tau_s if self.tau_s is not None else self.sample_interval_s
        count = sample_count(self.window_s, tau_s)
        step = sample_count(tau_s, self.sample_interval_s)
        start = round(self.start_s / self.sample_interval_s)
        needed = start + (count - 1) * step + 1
        if start < 0:
            raise AnalysisError(f"the window starts {-self.start_s * 1e9:g} ns before the record: start at 0")
        if needed > recorded:
            raise AnalysisError(
                f"a window of {self.window_s * 1e9:g} ns from {self.start_s * 1e9:g} ns needs {needed} samples, the "
                f"records have {recorded} ({recorded * self.sample_interval_s * 1e9:g} ns): use a shorter window or "
                "record longer"
            )
        return start + step * np.arange(count)


def as_float(values: NDArray[Any]) -> NDArray[np.floating]:
    """float64 stays, all else becomes float32, which holds every 8- and 16-bit code exactly."""
    return values.astype(np.float64 if values.dtype == np.float64 else np.float32, copy=False)


def _three_axes(records: NDArray[Any]) -> tuple[int, int, int]:
    if records.ndim != 3 or 0 in records.shape:
        raise AnalysisError(f"records of shape {records.shape}: expected (shots, ports, samples), none of them empty")
    shots, ports, samples = records.shape
    return shots, ports, samples
