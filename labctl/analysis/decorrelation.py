"""How fast speckle forgets with wavelength: correlation of traces against detuning, its half width, the delay spread.

What is measured is the correlation of *intensities*. Behind a fibre of many modes the field is circular Gaussian, and
the correlation of its intensity is the squared modulus of that of the field (Siegert's relation), which is the Fourier
transform of the distribution p of the modes' delays:

    C(dnu) = |gamma(dnu)|^2,   gamma(dnu) = integral of p(tau) exp(-2 pi i dnu tau) dtau

A phase drive changes nothing in this, since the light it makes has the same power at all times; it only shows many
masks one after the other. The half width of C is that of the intensity; that of |gamma| is larger.

Normalised as by Redding: covariances over the traces, 1 for the same light. The noise of the receiver, the same light
never giving the same trace, is taken off the variances; what it is, is seen on an image that is shown twice.

Sources: Goodman, Speckle Phenomena in Optics, ch. 3 (Siegert) and 5 (frequency dependence); Redding et al., Opt.
Express 21, 6584 (2013); Gloge, Appl. Opt. 10, 2252 (1971) for the delays.
"""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from labctl.errors import AnalysisError

SPEED_OF_LIGHT = 299_792_458.0
Launch = Literal["gaussian", "filled"]
Verdict = Literal["measured", "too coarse", "too short"]

HALF_WIDTHS_SCANNED = 2.0
"""A scan of fewer half widths saw no two independent speckles: that it falls to one half may be chance."""
HELD_SYMBOL = 2 / 3
"""Equivalent width of |field autocorrelation|^2 of a drive of random phases, each held for a symbol, in symbols."""
MODES, REPLICAS = 300, 100
"""Of the fibres by which the uncertainty is found: its own is 7 %."""
LEAST_MEMORY = 3.0
"""Below so many of these widths a fibre mixes too few symbols for its light to be Gaussian."""


@dataclass(frozen=True)
class Scan:
    """The same images at wavelengths that are evenly spaced.

    Attributes:
        traces: (wavelengths, images, ports, samples) V.
        repeats: (wavelengths, pairs, ports, samples) V, difference of two traces of one image; may hold no pair.
        centre_nm: Middle of the scan, nm.
        step_nm: From one wavelength to the next, nm.
        symbol_s: How long the drive holds a phase, s; 0 = it does not change.
        ports: What the third axis is; 0 = the fibre before the chip.
    """

    traces: NDArray[np.floating]
    repeats: NDArray[np.floating]
    centre_nm: float
    step_nm: float
    symbol_s: float
    ports: tuple[int, ...]


@dataclass(frozen=True)
class Decorrelation:
    """What a scan says.

    Attributes:
        detuning_nm: (k,) from 0 on, nm.
        correlation: (k,) intensity correlation, 1 at 0.
        verdict: Whether the scan is fine and long enough to tell a half width.
        half_width_nm: Detuning at which the correlation falls to one half, nm; None where the scan cannot tell.
        uncertainty_nm: Standard deviation of the half width, nm; None where there is none.
        images: How many images it is the mean of.
        likeness: Mean correlation of the traces of different images at one wavelength, 0..1; 1 for a single image.
    """

    detuning_nm: NDArray[np.float64]
    correlation: NDArray[np.float64]
    verdict: Verdict
    half_width_nm: float | None
    uncertainty_nm: float | None
    images: int
    likeness: float


def decorrelation(scan: Scan) -> Decorrelation:
    """Correlation against detuning, averaged over all pairs of wavelengths so far apart, all images and ports.

    Each trace is centred on its own mean. The half width is that of this fibre. Light of the symbols that are in it at
    a time interferes; each group of modes of equal delay thereby counts for more or less by chance, for like images
    alike, and so does each symbol of the window: that is the uncertainty.

    Raises:
        AnalysisError: Fewer than two wavelengths, or traces of noise alone.
    """
    wavelengths, images = scan.traces.shape[:2]
    if wavelengths < 2:
        raise AnalysisError("a scan of one wavelength shows no correlation: ask for more steps")
    repeats = _centred(scan.repeats)
    noise = float(np.mean(np.sum(repeats**2, axis=(2, 3)))) / 2 if repeats.size else 0.0
    correlation, products = _correlations(scan.traces, noise)
    detuning_nm = np.round(scan.step_nm * np.arange(wavelengths, dtype=np.float64), 9)
    verdict, half_width = _half_width(detuning_nm, correlation)
    uncertainty = None
    if half_width is not None and scan.symbol_s > 0:
        uncertainty = _uncertainty(scan, half_width, detuning_nm, products)
    return Decorrelation(detuning_nm, correlation, verdict, half_width, uncertainty, images, _likeness(products))


def crossing(detuning: NDArray[np.floating], correlation: NDArray[np.floating], level: float = 0.5) -> float | None:
    """First detuning at which a correlation (k,) falls to `level`, by straight lines between points; None: nowhere."""
    below = np.flatnonzero(correlation < level)
    if not below.size or below[0] == 0:
        return None
    last, first = int(below[0]) - 1, int(below[0])
    part = (correlation[last] - level) / (correlation[last] - correlation[first])
    return float(detuning[last] + part * (detuning[first] - detuning[last]))


def frequency_hz(detuning_nm: float, wavelength_nm: float) -> float:
    """A small change of wavelength as one of optical frequency: c dlambda / lambda^2, Hz."""
    return SPEED_OF_LIGHT * detuning_nm * 1e-9 / (wavelength_nm * 1e-9) ** 2


def expected_correlation(
    detuning_hz: NDArray[np.floating], spread_s: float, *, launch: Launch, symbol_s: float
) -> NDArray[np.float64]:
    """What `decorrelation` finds on average behind a fibre of delay spread `spread_s` = L NA^2 / (2 n c).

    Gaussian launch, 1/e^2 at NA: p = (2/T) exp(-2 tau / T), |gamma|^2 = 1 / (1 + (pi T dnu)^2). Filled up to NA: p
    uniform over T, |gamma|^2 = sinc^2(T dnu). Of the fibre's T only T / tau_d symbols are independent, with tau_d =
    2/3 of a symbol, and the mean of a trace varies with the interference among them, by the part s = (tau_d) times the
    integral of p^2 = tau_d / T of the variance, whatever the detuning: a trace that is centred on its own mean
    correlates as (|gamma|^2 - s) / (1 - s).

    Args:
        detuning_hz: (k,) Hz.
        spread_s: T, s.
        launch: How the light fills the aperture.
        symbol_s: How long the drive holds a phase, s.

    Returns:
        (k,)
    """
    x = np.asarray(detuning_hz, np.float64) * spread_s
    light = 1 / (1 + (np.pi * x) ** 2) if launch == "gaussian" else np.sinc(x) ** 2
    share = HELD_SYMBOL * symbol_s / spread_s
    expected: NDArray[np.float64] = (light - share) / (1 - share)
    return expected


def expected_half_width_hz(spread_s: float, *, launch: Launch, symbol_s: float) -> float:
    """Detuning (Hz) at which `expected_correlation` is one half."""
    level = (1 + HELD_SYMBOL * symbol_s / spread_s) / 2
    if launch == "gaussian":
        return math.sqrt(1 / level - 1) / (math.pi * spread_s)
    return float(brentq(lambda x: float(np.sinc(x)) ** 2 - level, 0.0, 1.0)) / spread_s


def delay_spread_s(half_width_hz: float, *, launch: Launch, symbol_s: float) -> float | None:
    """The delay spread T (s) at which one expects such a half width; None: too short for a drive of such symbols."""

    def excess(spread_s: float) -> float:
        return expected_half_width_hz(spread_s, launch=launch, symbol_s=symbol_s) - half_width_hz

    longest = 1 / half_width_hz
    shortest = max(LEAST_MEMORY * HELD_SYMBOL * symbol_s, 1e-3 * longest)
    if shortest >= longest or excess(shortest) < 0:
        return None
    return float(brentq(excess, shortest, longest, xtol=1e-15))


def _centred(traces: NDArray[np.floating]) -> NDArray[np.float64]:
    exact = traces.astype(np.float64)
    exact -= exact.mean(axis=-1, keepdims=True)
    return exact


def _correlations(traces: NDArray[np.floating], noise: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean correlation (k,) of wavelengths k steps apart, and products (images, images) of the traces of all pairs.

    `noise` is what a trace's sum of squares has of it.
    """
    centred = _centred(traces)
    products = np.einsum("ivpt,jvpt->ij", centred, centred, optimize=True)
    signal = np.diagonal(products) - traces.shape[1] * noise
    if np.any(signal <= 0):
        raise AnalysisError("the traces hold nothing but noise: check that light reaches the detector, or average more")
    ratios = products / np.sqrt(np.outer(signal, signal))
    against = np.array([1.0, *(float(np.diagonal(ratios, apart).mean()) for apart in range(1, len(ratios)))])
    return against, np.einsum("ivpt,iwpt->vw", centred, centred, optimize=True)


def _uncertainty(
    scan: Scan, half_width_nm: float, detuning_nm: NDArray[np.float64], products: NDArray[np.float64]
) -> float | None:
    """Of a half width (nm): how fibres of such a one come out that differ by chance alone.

    The parametric bootstrap (Efron & Tibshirani, An Introduction to the Bootstrap, 1993, 6.5): scans of fibres of
    circular Gaussian modes, with a Gaussian launch, of as many symbols, and of images as bright and as like each other
    as these, by the `products` of their traces; intensities correlate as the square of fields. Root mean square of the
    logarithms about the true one; None if most cannot tell.
    """
    wavelengths, images, _, samples = scan.traces.shape
    per_nm = frequency_hz(1.0, scan.centre_nm)
    spread_s = delay_spread_s(per_nm * half_width_nm, launch="gaussian", symbol_s=scan.symbol_s)
    if spread_s is None:
        return None
    true_nm = expected_half_width_hz(spread_s, launch="gaussian", symbol_s=scan.symbol_s) / per_nm
    delays = -0.5 * spread_s * np.log1p(-(np.arange(MODES) + 0.5) / MODES)
    latest = math.ceil(float(delays.max()) / scan.symbol_s)
    arrived = np.rint(latest + np.arange(samples) - delays[:, np.newaxis] / scan.symbol_s).astype(np.intp)
    turns = np.exp(-2j * np.pi * per_nm * detuning_nm[:, np.newaxis, np.newaxis] * delays)
    power, directions = np.linalg.eigh(np.sqrt(np.clip(products, 0, None)))
    mixing = directions * np.sqrt(np.clip(power, 0, None))
    generator = np.random.default_rng(1)
    widths = []
    for _ in range(REPLICAS):
        parts = generator.normal(size=(2, images, MODES))
        phases = np.exp(2j * np.pi * generator.random(latest + samples + 1))
        fields = (turns * (mixing @ (parts[0] + 1j * parts[1]))).reshape(-1, MODES) @ phases[arrived]
        light = (np.abs(fields) ** 2).reshape(wavelengths, images, 1, samples)
        widths.append(crossing(detuning_nm, _correlations(light, 0.0)[0]))
    known = np.array([width for width in widths if width is not None])
    if 2 * known.size < REPLICAS:
        return None
    return half_width_nm * math.sqrt(float(np.mean(np.log(known / true_nm) ** 2)))


def _likeness(products: NDArray[np.float64]) -> float:
    """Mean correlation of different images, an image weighing as much as its traces vary, as in the correlation."""
    variance = np.diagonal(products)
    if variance.size == 1:
        return 1.0
    weights = np.outer(variance, variance)
    other = ~np.eye(variance.size, dtype=np.bool_)
    alike = products / np.sqrt(weights)
    return float(np.clip(np.average(alike[other], weights=weights[other]), 0, 1))


def _half_width(detuning_nm: NDArray[np.float64], correlation: NDArray[np.float64]) -> tuple[Verdict, float | None]:
    if correlation[1] < 0.5:
        return "too coarse", None
    found = crossing(detuning_nm, correlation)
    if found is None or HALF_WIDTHS_SCANNED * found > detuning_nm[-1]:
        return "too short", None
    return "measured", found
