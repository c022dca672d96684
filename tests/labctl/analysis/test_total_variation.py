import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from labctl.analysis.total_variation import divergence, gradient, least_total_variation, total_variation
from labctl.errors import AnalysisError

SHAPE = (6, 5)


@given(st.integers(0, 2**32 - 1))
def test_the_divergence_is_the_negative_adjoint_of_the_gradient(seed: int) -> None:
    generator = np.random.default_rng(seed)
    images, slopes = generator.normal(size=(2, *SHAPE)), generator.normal(size=(2, 2, *SHAPE))
    assert np.sum(gradient(images) * slopes) == pytest.approx(-np.sum(images * divergence(slopes)))


def test_total_variation_is_the_length_of_the_edges() -> None:
    square = np.zeros((1, 8, 8))
    square[0, 2:6, 2:6] = 1
    assert total_variation(square) == pytest.approx(16, abs=1)
    assert total_variation(np.full((1, 8, 8), 0.3)) == 0


@pytest.mark.parametrize("strength", [0.01, 0.1, 1.0])
def test_it_finds_what_a_general_minimiser_finds(strength: float) -> None:
    generator = np.random.default_rng(3)
    masks = generator.normal(size=(20, 30))
    seen = masks @ (generator.random(30) < 0.4) + generator.normal(0, 0.3, 20)

    def objective(image: np.ndarray) -> float:
        return float(np.sum((masks @ image - seen) ** 2) / 2 + strength * total_variation(image.reshape(1, *SHAPE))[0])

    found = least_total_variation(masks.T @ masks, (seen @ masks)[np.newaxis], SHAPE, strength).ravel()
    general = minimize(objective, found.clip(0.01, 0.99), bounds=[(0, 1)] * 30, method="L-BFGS-B")
    assert objective(found) <= general.fun + 0.01 * abs(general.fun)
    assert np.all((found >= 0) & (found <= 1))


def test_blocks_come_back_from_half_as_many_measurements_as_pixels() -> None:
    generator = np.random.default_rng(5)
    image = np.zeros((12, 12))
    image[3:9, 2:7] = 1
    masks = generator.normal(size=(72, 144))
    seen = masks @ image.ravel() + generator.normal(0, 0.1, 72)
    (found,) = least_total_variation(masks.T @ masks, (seen @ masks)[np.newaxis], (12, 12), 1.0)
    least_squares = np.linalg.lstsq(masks, seen, rcond=None)[0].reshape(12, 12)
    assert np.sqrt(np.mean((found - image) ** 2)) < 0.05 < np.sqrt(np.mean((least_squares - image) ** 2)) / 4


def test_images_do_not_depend_on_each_other() -> None:
    generator = np.random.default_rng(6)
    masks = generator.normal(size=(25, 30))
    projected = (generator.random((3, 30)) < 0.5) @ masks.T @ masks
    together = least_total_variation(masks.T @ masks, projected, SHAPE, 0.3)
    alone = least_total_variation(masks.T @ masks, projected[:1], SHAPE, 0.3)
    assert np.allclose(together[0], alone[0], atol=0.01)


@pytest.mark.parametrize(("strength", "pixels"), [(0.0, 30), (1.0, 29)])
def test_what_makes_no_problem_is_refused(strength: float, pixels: int) -> None:
    with pytest.raises(AnalysisError, match="strength above 0"):
        least_total_variation(np.eye(pixels), np.zeros((1, pixels)), SHAPE, strength)
