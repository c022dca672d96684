import numpy as np
import pytest
from numpy.typing import NDArray

from labctl.analysis.photons import photon_transfer, photons_needed, photons_of_equal_noise, relative, scores_at
from labctl.errors import AnalysisError

VOLTS = np.array([0.05, 0.002])
"""Of a photon on each port."""
OFFSET_V = 0.3


def records(photons: float, *, repeats: int = 60, noise_v: float = 0.0, drift: float = 0.0) -> NDArray[np.float64]:
    """Poisson numbers of a picture that has speckle, on two ports of different gain; `drift` of the light in all."""
    generator = np.random.default_rng(1)
    light = photons * generator.exponential(size=(1, 2, 50))
    counts = generator.poisson(light * np.linspace(1, 1 + drift, repeats)[:, None, None])
    return np.asarray(OFFSET_V + counts * VOLTS[:, None] + generator.normal(0, noise_v, counts.shape))


@pytest.mark.parametrize("photons", [0.3, 3.0, 100.0])
@pytest.mark.parametrize("drift", [0.0, 0.5])
def test_a_photon_is_found_from_how_noise_grows_with_light(photons: float, drift: float) -> None:
    scale = photon_transfer(records(photons, drift=drift), records(0.0))
    assert scale.volts_per_photon == pytest.approx(VOLTS, rel=0.15)
    assert scale.dark_v == pytest.approx(OFFSET_V)
    assert scale.photons(np.full((1, 2, 1), OFFSET_V) + VOLTS[:, None]) == pytest.approx(1.0, rel=0.15)


def test_noise_that_is_there_in_the_dark_is_none_of_the_light() -> None:
    scale = photon_transfer(records(10.0, noise_v=0.004), records(0.0, noise_v=0.004))
    assert scale.volts_per_photon == pytest.approx(VOLTS, rel=0.15)


def test_photons_that_cannot_be_told_from_noise_are_an_error() -> None:
    with pytest.raises(AnalysisError, match="noise of record 0 does not grow with its light"):
        photon_transfer(np.tile(records(10.0)[:1], (5, 1, 1)), records(0.0))
    with pytest.raises(AnalysisError, match="a smaller reference_every gives more"):
        photon_transfer(records(10.0)[:2], records(0.0))


@pytest.mark.parametrize("noise_v", [0.0, 1.0])
def test_the_noise_of_records_is_that_of_so_many_photons(noise_v: float) -> None:
    """In volts each port has another share of the light: an ideal counter of n photons gives it as many of them."""
    repeats = records(1000.0, noise_v=noise_v) - OFFSET_V
    light = np.tile(repeats.mean(axis=0), (3, 1, 1))
    mean = light.mean(axis=(0, 2))
    variance = repeats.var(axis=0, ddof=1).mean(axis=1)
    expected = min(mean.mean() * mean / variance)
    assert photons_of_equal_noise(repeats, light) == pytest.approx(expected, rel=0.05)


def test_an_ideal_counter_has_as_much_noise_as_itself() -> None:
    share = np.array([0.5, 1.5])[:, None]
    counted = np.random.default_rng(1).poisson(200.0 * share, (400, 2, 50))
    assert photons_of_equal_noise(counted, counted) == pytest.approx(200.0, rel=0.03)
    with pytest.raises(AnalysisError, match="do not say what the noise is"):
        photons_of_equal_noise(counted[:1], counted)
    with pytest.raises(AnalysisError, match="all the same"):
        photons_of_equal_noise(np.ones((4, 2, 50)), counted)


def test_light_is_in_units_of_its_mean_and_never_negative() -> None:
    assert relative(np.array([3.0, 1.0, -1.0])) == pytest.approx([2.25, 0.75, 0.0])
    with pytest.raises(AnalysisError, match="no light"):
        relative(np.zeros(3))


def test_photons_needed_lie_between_the_points_of_the_curve() -> None:
    assert photons_needed([1, 10, 100], [0.6, 0.8, 1.0], 0.9) == pytest.approx(10**1.5)
    assert photons_needed([1, 10], [0.95, 0.99], 0.9) == 1
    assert photons_needed([1, 10], [0.6, 0.8], 0.9) is None


def test_scores_lie_between_those_of_the_nearest_levels() -> None:
    levels = [np.array([0.5, 0.6]), np.array([0.7, 1.0])]
    assert scores_at([1.0, 100.0], levels, 10.0) == pytest.approx([0.6, 0.8])
    assert scores_at([100.0, 1.0], levels[::-1], 100.0) == pytest.approx([0.7, 1.0])
