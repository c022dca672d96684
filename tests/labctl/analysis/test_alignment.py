"""The estimators of an alignment on signals whose truth is known."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from labctl.analysis.alignment import contrast, flat_top, level, noise, repeatability_db, used_range
from labctl.analysis.drive_depth import drive_depth
from labctl.analysis.estimates import Estimate
from labctl.analysis.light_delay import light_delay, responses
from labctl.analysis.likelihood import interval, lowest
from labctl.errors import AnalysisError
from protocols.alignment import LEVELS, maximum_length_sequence

INTERVAL, HOLD = 20e-12, 40e-12


def near(found: Estimate, true: float) -> bool:
    return abs(found.value - true) <= 4 * found.uncertainty


@pytest.mark.parametrize("order", [5, 7, 9])
def test_a_maximum_length_sequence_is_like_noise(order: int) -> None:
    sequence = maximum_length_sequence(order)
    assert sequence.size == 2**order - 1
    spectrum = np.abs(np.fft.fft(sequence)) ** 2
    correlation = np.fft.ifft(spectrum).real
    assert correlation == pytest.approx([sequence.size, *[-1] * (sequence.size - 1)], abs=1e-6)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1021), st.floats(0.1, 10), st.floats(-1, 1))
def test_the_response_is_found_whatever_the_level_and_the_even_part(place: int, size: float, offset: float) -> None:
    sequence = maximum_length_sequence(9)
    response = np.zeros(1022)
    response[[place, (place + 7) % 1022]] = size, -size
    held = np.zeros(1022)
    held[::2] = sequence
    linear = np.fft.ifft(np.fft.fft(held) * np.fft.fft(response)).real
    even = offset + 0.3 * np.roll(linear, 5) ** 2
    found = responses((even + linear)[np.newaxis], (even - linear)[np.newaxis], sequence)
    assert found[0] == pytest.approx(response, abs=1e-9 + 0.02 * size)


def walks(generator: np.random.Generator, delay_s: float, decay_s: float, count: int = 32) -> NDArray[np.float64]:
    """Responses of fibres of many modes behind three poles and a Gaussian oscilloscope, on a grid of 1 ps."""
    step = 1e-12
    time = step * (np.arange(8192) - 200)
    electronics = (np.arange(8192) < round(HOLD / step)).astype(np.float64)
    frequency = np.fft.rfftfreq(8192, step)
    shape = np.exp(-math.log(2) / 2 * (frequency / 25e9) ** 2)
    for pole in (14e9, 16e9, 12e9):
        shape = shape / (1 + 1j * frequency / pole)
    delays = delay_s + generator.exponential(decay_s, 2000)
    fields = generator.normal(size=(count, 2000)) + 1j * generator.normal(size=(count, 2000))
    steps = np.imag(np.conj(fields.sum(axis=1, keepdims=True)) * fields)
    places = np.rint((delays - time[0]) / step).astype(int)
    inside = places < 8000
    impulses = np.array([np.bincount(places[inside], row[inside], 8192) for row in steps])
    smooth = np.fft.irfft(np.fft.rfft(impulses, axis=1) * np.fft.rfft(electronics) * shape, 8192, axis=1)
    found = np.zeros((count, 1022))
    first = round(-time[0] / INTERVAL)
    whole = smooth[:, :: round(INTERVAL / step)]
    found[:, : whole.shape[1] - first] = whole[:, first:]
    return np.asarray(found + 3e-3 * found.std(axis=1, keepdims=True) * generator.normal(size=found.shape))


@pytest.mark.parametrize("delay_s", [2.003e-9, 2.0111e-9])
def test_first_light_is_found_to_a_tenth_of_a_sample(delay_s: float) -> None:
    found = light_delay(
        walks(np.random.default_rng(3), delay_s, 0.19e-9), interval_s=INTERVAL, hold_s=HOLD, scope_hz=25e9
    )
    assert near(found.delay, delay_s)
    assert found.delay.uncertainty < 0.1 * HOLD
    assert near(found.rise, sum(1 / (2 * math.pi * pole) for pole in (14e9, 16e9, 12e9)))


def test_noise_has_no_delay() -> None:
    with pytest.raises(AnalysisError, match="the light does not follow the drive"):
        light_delay(np.random.default_rng(1).normal(size=(8, 1022)), interval_s=INTERVAL, hold_s=HOLD, scope_hz=25e9)


def hopped(
    steps: tuple[float, ...], generator: np.random.Generator, pairs: tuple[tuple[int, int], ...]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], tuple[float, float]]:
    """Idle and mean signals of 12 images behind a fibre, for steps of phase and two poles of 11 and 10 ps."""
    sequence = (maximum_length_sequence(5) + 1) / 2
    delays = generator.exponential(0.19e-9, 700)
    fields = generator.normal(size=(12, 700)) + 1j * generator.normal(size=(12, 700))
    phases = np.concatenate([[0.0], np.cumsum(steps)])
    idle = np.abs(fields.sum(axis=1)) ** 2
    signals = []
    holds = (0.4e-9, 0.8e-9)
    for hold in holds:
        held = np.repeat(sequence, round(hold / 5e-12))
        frequency = np.fft.fftfreq(held.size, 5e-12)
        poles = (1 + 2j * np.pi * frequency * 11e-12) * (1 + 2j * np.pi * frequency * 10e-12)
        q = np.fft.ifft(np.fft.fft(held) / poles).real
        transfer = fields @ np.exp(-2j * np.pi * np.multiply.outer(delays, frequency))
        for low, high in pairs:
            drive = np.exp(1j * (phases[low] + (phases[high] - phases[low]) * q))
            signals.append((np.abs(transfer * np.fft.fft(drive) / held.size) ** 2).sum(axis=1))
    noisy = np.array(signals).reshape(2, len(pairs), 12)
    scatter = 2e-4 * idle.mean()
    return (
        idle + scatter * generator.normal(size=12),
        noisy + scatter * generator.normal(size=noisy.shape),
        sequence,
        holds,
    )


def test_the_depth_is_the_sum_of_its_steps() -> None:
    pairs = ((0, 1), (1, 2), (2, 3), (3, 4), (0, 2), (1, 3), (2, 4))
    steps = (1.47, 1.70, 1.70, 1.47)
    idle, hopping, sequence, holds = hopped(steps, np.random.default_rng(4), pairs)
    found = drive_depth(idle, hopping, pairs=pairs, levels=LEVELS, hold_s=holds, sequence=sequence)
    assert near(found.depth, sum(steps))
    assert found.depth.uncertainty < 0.03 * sum(steps)


def test_signals_that_do_not_follow_the_drive_have_no_depth() -> None:
    generator = np.random.default_rng(1)
    with pytest.raises(AnalysisError, match="the mean signal does not follow the drive"):
        drive_depth(
            generator.normal(size=12),
            generator.normal(size=(2, 7, 12)),
            pairs=((0, 1), (1, 2), (2, 3), (3, 4), (0, 2), (1, 3), (2, 4)),
            levels=LEVELS,
            hold_s=(0.4e-9, 0.8e-9),
            sequence=(maximum_length_sequence(5) + 1) / 2,
        )


def test_levels_noise_range_ratio_and_contrast() -> None:
    generator = np.random.default_rng(2)
    dark = 2e-3 + generator.normal(0, 1e-3, (32, 100))
    assert near(level(dark), 2e-3)
    assert near(noise(dark), 1e-3)
    images = generator.exponential(0.05, (1, 16, 100))
    twice = images + 2e-3 + generator.normal(0, 2e-4, (2, 16, 100))
    assert near(used_range(twice, 1.0), float(np.ptp(images)))
    spread = math.sqrt(float(images[0].var(axis=0, ddof=1).mean()))
    assert near(contrast(twice, Estimate(2e-3, 1e-5)), spread / float(images.mean()))
    frames = images[0, 0] + generator.normal(0, 5e-3, (48, 100))
    assert near(repeatability_db(frames), 10 * math.log10(float(images[0, 0].var(ddof=1)) / 25e-6))


def test_a_detector_that_gives_no_more_has_a_flat_top() -> None:
    generator = np.random.default_rng(5)
    images = generator.exponential(0.05, (1, 16, 100))
    noise_v = generator.normal(0, 2e-4, (2, 16, 100))
    assert not flat_top(images + noise_v)
    assert flat_top(np.minimum(images, 0.15) + noise_v)


def test_a_likelihood_is_searched_and_read_where_it_is_stated() -> None:
    """A parameter that enters by its square, 0.25 +- 0.1, beside another that is a thousand times better known."""

    def cost(place: NDArray[np.float64]) -> float:
        return float((place[0] ** 2 - 0.25) ** 2 / 0.02 + ((place[1] - 3) / 1e-4) ** 2 / 2)

    best = np.abs(lowest(cost, np.array([1.0, 1.0])))
    assert best == pytest.approx([0.5, 3.0], abs=0.02)
    low, high = interval(cost, best, 4.0, least=0.0)
    assert low == 0
    assert high == pytest.approx(math.sqrt(0.65), rel=0.01)
    low, high = interval(cost, best, 1.0, least=0.0)
    assert (low, high) == pytest.approx((math.sqrt(0.15), math.sqrt(0.35)), rel=0.01)
