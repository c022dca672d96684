"""Symbols in series: the features of each symbol of a sequence that is modulated straight onto the light.

Symbol n occupies the slot [n T, (n + 1) T) after the light of symbol 0 reaches the detector. What is sampled later
holds light of symbol n + 1, which in a prediction task is the answer itself. Features therefore come from samples that
were taken inside the slot; no interpolation, whose kernel would reach across the slot's end.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.errors import AnalysisError

EARLY_TOLERANCE = 1e-6
"""Part of a sample by which a slot's first sample may come early: rounding, never light of another symbol."""

DRIFT_TOLERANCE = 0.01
"""Part of a sample by which the slots may drift against the samples over the whole sequence."""


def symbol_features(
    frames: NDArray[Any],
    *,
    first_s: ArrayLike,
    symbol_s: float,
    symbols: int,
    per_symbol: int,
    sample_interval_s: float,
) -> NDArray[Any]:
    """The samples of each symbol's own slot, port by port.

    Feature j of symbol n on a port is the first sample at or after first_s + n symbol_s + j symbol_s / per_symbol; it
    lies before first_s + (n + 1) symbol_s, wherever the samples lie against the slots.

    Args:
        frames: (shots, ports, samples), codes or volts as they were recorded. Records that went through `resample` mix
            16 samples on either side and are not fit for this.
        first_s: When the light of symbol 0 reaches the detector, s after the record's first sample: one number,
            (shots,) or (shots, ports). Where the oscilloscope reports the time from the trigger to its first sample,
            subtract it here.
        symbol_s: Length T of a slot, s, a whole number of sample intervals.
        symbols: How many symbols.
        per_symbol: Samples N of each slot; they must divide the slot evenly.
        sample_interval_s: s.

    Returns:
        (shots, symbols, ports * per_symbol), of the type of `frames`.

    Raises:
        AnalysisError: The slots do not fit the samples, or the sequence does not fit into the records.
    """
    records = np.asarray(frames)
    if records.ndim != 3 or 0 in records.shape:
        raise AnalysisError(f"records of shape {records.shape}: expected (shots, ports, samples), none of them empty")
    shots, ports, samples = records.shape
    slot = _samples_per_slot(symbol_s, sample_interval_s, symbols)
    if per_symbol < 1 or slot % per_symbol:
        raise AnalysisError(
            f"{per_symbol} samples of a slot of {slot} are not evenly spaced: use a divisor of {slot} a symbol"
        )
    start = _first_samples(first_s, sample_interval_s, (shots, ports))
    needed = int(start.max()) + symbols * slot - slot // per_symbol + 1
    if start.min() < 0 or needed > samples:
        raise AnalysisError(
            f"{symbols} symbols from sample {int(start.min())} on need samples 0 to {needed - 1}, the records have "
            f"{samples}: record from before the first symbol to the end of the last"
        )
    offsets = slot * np.arange(symbols)[:, np.newaxis] + slot // per_symbol * np.arange(per_symbol)
    taken = start[:, :, np.newaxis, np.newaxis] + offsets
    chosen = np.take_along_axis(records, taken.reshape(shots, ports, -1), axis=2)
    return chosen.reshape(shots, ports, symbols, per_symbol).transpose(0, 2, 1, 3).reshape(shots, symbols, -1)


def require_causal(
    features_of: Callable[[NDArray[Any]], NDArray[Any]],
    frames: NDArray[Any],
    *,
    first_s: ArrayLike,
    symbol_s: float,
    symbols: int,
    sample_interval_s: float,
    boundaries: int = 16,
) -> None:
    """Assert that no feature of a symbol depends on what was recorded after the end of that symbol's slot.

    The records are replaced from the start of a slot on, and every feature of an earlier symbol must stay as it was.

    Args:
        features_of: Whatever turns records into features (shots, symbols, ...), every step included but those that
            are fitted to all of the records at once.
        frames: (shots, ports, samples).
        first_s: When the light of symbol 0 reaches the detector, as in `symbol_features`.
        symbol_s: Length of a slot, s.
        symbols: How many symbols.
        sample_interval_s: s.
        boundaries: At how many slots, spread over the sequence, this is tried.

    Raises:
        AnalysisError: A feature changed, so it holds light of a later symbol.
    """
    records = np.asarray(frames)
    shots, ports, samples = records.shape
    slot = _samples_per_slot(symbol_s, sample_interval_s, symbols)
    start = _first_samples(first_s, sample_interval_s, (shots, ports))
    before = features_of(records)
    low, high = records.min(), records.max()
    replacement = np.where(records == high, low, high) if low != high else records + 1
    for boundary in np.unique(np.linspace(1, symbols - 1, min(boundaries, symbols - 1)).round().astype(int)):
        later = np.arange(samples) >= (start + boundary * slot)[:, :, np.newaxis]
        after = features_of(np.where(later, replacement, records))
        if not np.array_equal(after[:, :boundary], before[:, :boundary]):
            raise AnalysisError(
                f"features of symbols before {boundary} change with what is recorded from symbol {boundary} on: end "
                "each symbol's window before the light of the next one, and do not interpolate across"
            )


def one_step_ahead(series: ArrayLike) -> tuple[NDArray[Any], NDArray[Any]]:
    """Inputs u(n) and targets u(n + 1) of a series (n,) or (n, values), both one shorter than the series.

    Raises:
        AnalysisError: The series has fewer than two values.
    """
    values = np.asarray(series)
    if values.ndim < 1 or values.shape[0] < 2:
        raise AnalysisError(f"a series of shape {values.shape} has no next value: give two or more")
    return values[:-1], values[1:]


def _samples_per_slot(symbol_s: float, sample_interval_s: float, symbols: int) -> int:
    if not (symbol_s > 0 and sample_interval_s > 0 and symbols > 0):
        raise AnalysisError(
            f"{symbols} symbols of {symbol_s:g} s, sampled every {sample_interval_s:g} s: all must be above zero"
        )
    ratio = symbol_s / sample_interval_s
    slot = round(ratio)
    if slot < 1 or abs(ratio - slot) * symbols > DRIFT_TOLERANCE:
        raise AnalysisError(
            f"a symbol of {symbol_s * 1e12:g} ps is {ratio:.6g} samples of {sample_interval_s * 1e12:g} ps: sample at "
            "a whole multiple of the symbol rate"
        )
    return slot


def _first_samples(first_s: ArrayLike, sample_interval_s: float, shape: tuple[int, int]) -> NDArray[np.intp]:
    """First sample (shots, ports) at or after the light of symbol 0."""
    first = np.asarray(first_s, np.float64)
    if first.shape not in {(), shape[:1], shape}:
        raise AnalysisError(
            f"arrival times have shape {first.shape}, records {shape}: give one, one for each shot, or one for each "
            "shot and port"
        )
    if first.ndim == 1:
        first = first[:, np.newaxis]
    samples = np.ceil(first / sample_interval_s - EARLY_TOLERANCE).astype(np.intp)
    return np.broadcast_to(samples, shape)
