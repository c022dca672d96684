"""How many photons a record holds, and how many are enough."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from labctl.errors import AnalysisError

FEWEST_REPEATS = 3


@dataclass(frozen=True)
class PhotonScale:
    """What a photon means in the records of each port.

    A photon is one that the detector counts, a photoelectron.

    Attributes:
        volts_per_photon: (ports,) V, for a photon in the receiver's resolution time 1 / (2 B), B its noise bandwidth:
            40 ps behind 12 GHz.
        dark_v: (ports,) V without light.
    """

    volts_per_photon: NDArray[np.float64]
    dark_v: NDArray[np.float64]

    def photons(self, traces: NDArray[Any]) -> NDArray[np.float64]:
        """Traces (shots, ports, samples) of volts as numbers of photons, noise included."""
        volts = np.asarray(traces, np.float64) - self.dark_v[:, np.newaxis]
        return np.asarray(volts / self.volts_per_photon[:, np.newaxis])


def photon_transfer(repeats: NDArray[Any], dark: NDArray[Any]) -> PhotonScale:
    """The scale of each port from records of one picture again and again, and from dark ones.

    The number of photons in a resolution time is a Poisson number: its variance is its mean. So the volts of a photon
    are what the variance over the repeats, summed over a record, exceeds that of darkness by, over the sum of the mean.
    The variance is that of differences between successive repeats, so that slow drift does not count. What fluctuates
    in proportion to the light (laser, trigger) counts as photons that are missing: a relative noise s makes n photons
    n / (1 + s^2 n).
    Source: Janesick, Photon Transfer (SPIE 2007), ch. 4 and 5.

    Args:
        repeats: (n, ports, samples) V, in the order of measurement.
        dark: (k, ports, samples) V.

    Raises:
        AnalysisError: Too few repeats, or a port whose noise does not grow with its light.
    """
    if len(repeats) < FEWEST_REPEATS or not len(dark):
        raise AnalysisError(
            f"{len(repeats)} records of the reference image and {len(dark)} dark ones do not say what a photon is: "
            f"measure at least {FEWEST_REPEATS} and 1, a smaller reference_every gives more"
        )
    values = np.asarray(repeats, np.float64)
    darkness = np.asarray(dark, np.float64)
    dark_v = darkness.mean(axis=(0, 2))
    noise = _variance(values) - darkness.var(axis=(0, 2))
    light = values.mean(axis=(0, 2)) - dark_v
    if dead := np.flatnonzero((light <= 0) | (noise <= 0)).tolist():
        raise AnalysisError(
            f"the noise of record {dead[0]} does not grow with its light: photons cannot be told from the receiver's "
            "own noise, use more light or a quieter receiver"
        )
    return PhotonScale(noise / light, dark_v)


def photons_of_equal_noise(repeats: NDArray[Any], light: NDArray[Any]) -> float:
    """With how many photons a sample an ideal counter has as much noise as records do, on the port that has most.

    Of n photons, the mean over all ports and samples, a port gets its part of the mean light m, n m_p / m. Their
    variance in the records' units is m m_p / n, and that of the records at n = m m_p / variance. It is the noise at the
    light of that picture; rounding that is the same in all repeats is not seen, and needs noise in front of it.

    Args:
        repeats: (n, ports, samples) of one picture again and again, in the order of measurement.
        light: (shots, ports, samples) in the same units, darkness at zero.

    Raises:
        AnalysisError: Fewer than two repeats, or no noise at all.
    """
    if len(repeats) < 2:
        raise AnalysisError(f"{len(repeats)} records of the reference image do not say what the noise is: measure 2")
    variance = _variance(np.asarray(repeats, np.float64))
    mean = np.asarray(light, np.float64).mean(axis=(0, 2))
    noisy = variance > 0
    if not noisy.any():
        raise AnalysisError("the records of the reference image are all the same: their noise cannot be measured")
    return float(mean.mean() * np.min(mean[noisy] / variance[noisy]))


def relative(light: NDArray[Any]) -> NDArray[np.float64]:
    """Light in units of its mean; what is below zero is noise and counts as dark.

    Raises:
        AnalysisError: There is none.
    """
    power = np.maximum(np.asarray(light, np.float64), 0.0)
    if not power.any():
        raise AnalysisError("the records hold no light: nothing can be counted")
    return np.asarray(power / power.mean())


def scores_at(photons: Sequence[float], scores: Sequence[NDArray[np.float64]], wanted: float) -> NDArray[np.float64]:
    """Scores (splits,) with `wanted` photons, between those of the two nearest levels of light on a logarithmic axis.

    Args:
        photons: Of each level, in any order.
        scores: (splits,) of each level.
        wanted: Photons, from the lowest to the highest level.
    """
    order = np.argsort(photons)
    light, by_split = np.log(photons)[order], np.transpose(scores)[:, order]
    return np.array([np.interp(np.log(wanted), light, split) for split in by_split])


def photons_needed(photons: Sequence[float], accuracies: Sequence[float], wanted: float) -> float | None:
    """Fewest photons with which an accuracy is reached, between the points of a curve on a logarithmic axis.

    Args:
        photons: Rising.
        accuracies: At each of them.
        wanted: Accuracy to reach.

    Returns:
        None: no point of the curve reaches it. The first point, if it does.

    Example:
        >>> from labctl.analysis.photons import photons_needed
        >>> round(photons_needed([1, 10, 100], [0.6, 0.8, 1.0], 0.9), 1)
        31.6
    """
    reached = np.flatnonzero(np.asarray(accuracies) >= wanted)
    if not reached.size:
        return None
    first = int(reached[0])
    if first == 0:
        return float(photons[0])
    part = (wanted - accuracies[first - 1]) / (accuracies[first] - accuracies[first - 1])
    return float(photons[first - 1] * (photons[first] / photons[first - 1]) ** part)


def _variance(repeats: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of each port (ports,), by differences between successive repeats, so that slow drift does not count."""
    return np.asarray(np.mean(np.diff(repeats, axis=0) ** 2, axis=(0, 2)) / 2)
