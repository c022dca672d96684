"""What the virtual AWG's editing commands do to samples: pure functions.

Source: instrument facts 1.4. A shift by degrees moves the end of the waveform to its front, as a rotation does, and is
rounded to whole samples; both are recalled.
"""

import numpy as np
from numpy.typing import NDArray


def points_of(degrees: float, length: int) -> int:
    """A phase (degrees, 360 for the whole waveform) in whole samples."""
    return round(degrees / 360 * length)


def inverted(samples: NDArray[np.float32]) -> NDArray[np.float32]:
    """Turned upside down about the middle of its range, which is the offset."""
    return np.asarray(samples.max() + samples.min() - samples, np.float32)


def offset(samples: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """Moved by a part of the full scale."""
    return np.asarray(samples + np.float32(factor), np.float32)


def scaled(samples: NDArray[np.float32], factor: float) -> NDArray[np.float32]:
    """So many times as large."""
    return np.asarray(samples * np.float32(factor), np.float32)


def normalised(samples: NDArray[np.float32], *, keep_zero: bool) -> NDArray[np.float32]:
    """Stretched to -1..1: by one factor with `keep_zero`, otherwise minimum to -1 and maximum to 1.

    Samples that have no extent, or an infinite one, come back as they are.
    """
    low, high = float(samples.min()), float(samples.max())
    centre = 0.0 if keep_zero else (low + high) / 2
    extent = max(abs(low), abs(high)) if keep_zero else (high - low) / 2
    return np.asarray((samples - centre) / extent, np.float32) if 0 < extent < np.inf else samples


def resampled(samples: NDArray[np.float32], size: int) -> NDArray[np.float32]:
    """The periodic waveform on `size` points, interpolated linearly."""
    at = np.arange(size) * (samples.size / size)
    return np.asarray(np.interp(at, np.arange(samples.size + 1), np.append(samples, samples[0])), np.float32)


def nearest(markers: NDArray[np.uint8], size: int) -> NDArray[np.uint8]:
    """The periodic markers on `size` points, each that of the sample at or before it."""
    return np.asarray(markers[np.arange(size) * markers.size // size])
