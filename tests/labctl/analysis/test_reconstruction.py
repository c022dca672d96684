import numpy as np
import pytest
from sklearn.base import clone
from sklearn.gaussian_process.kernels import RBF
from sklearn.kernel_ridge import KernelRidge
from sklearn.preprocessing import StandardScaler
from sklearn.utils.estimator_checks import parametrize_with_checks

from labctl.analysis.reconstruction import GAMMAS, SHARES, KernelReconstruction, LinearReconstruction
from labctl.analysis.regression import ridge_readout, rmse

ESTIMATORS = [LinearReconstruction(), KernelReconstruction()]


def speckle(shots: int = 120, features: int = 60, pixels: int = 25) -> tuple[np.ndarray, np.ndarray]:
    """Images of two strokes in random places, and what 60 detectors see of them: |a v|^2 with a little noise."""
    generator = np.random.default_rng(3)
    strokes = np.zeros((shots, 5, 5))
    strokes[np.arange(shots), generator.integers(0, 5, shots)] = 1
    strokes[np.arange(shots), :, generator.integers(0, 5, shots)] = 1
    images = strokes.reshape(shots, pixels)
    fields = generator.standard_normal((2, features, pixels))
    powers = np.sum((images @ fields.transpose(0, 2, 1)) ** 2, axis=0)
    return powers + 0.5 * generator.standard_normal(powers.shape), images


@parametrize_with_checks(ESTIMATORS)  # type: ignore[untyped-decorator]
def test_estimators_keep_to_scikit_learn(estimator: object, check: object) -> None:
    check(estimator)  # type: ignore[operator]


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=lambda estimator: type(estimator).__name__)
def test_images_are_found_again_and_lie_in_their_range(estimator: LinearReconstruction | KernelReconstruction) -> None:
    features, images = speckle()
    fitted = clone(estimator).fit(features[:100], images[:100])
    predicted = fitted.predict(features[100:])
    assert predicted.shape == (20, 25)
    assert predicted.min() >= 0
    assert predicted.max() <= 1
    mean_image = rmse(images[100:], np.tile(images[:100].mean(axis=0), (20, 1)))
    assert rmse(images[100:], predicted) < 0.6 * mean_image
    plain = clone(estimator).set_params(clip=False).fit(features[:100], images[:100]).predict(features[100:])
    np.testing.assert_allclose(plain.clip(0, 1), predicted)
    assert plain.max() > 1
    assert rmse(images[100:], plain) > rmse(images[100:], predicted)


def test_a_kernel_reads_what_is_quadratic_in_the_image_better_than_a_line_does() -> None:
    features, images = speckle(features=12)
    linear, kernel = (clone(one).fit(features[:100], images[:100]).predict(features[100:]) for one in ESTIMATORS)
    assert rmse(images[100:], kernel) < rmse(images[100:], linear)


def test_without_limits_the_linear_one_is_the_ridge_readout() -> None:
    features, images = speckle()
    for targets in (images, images[:, 0], images @ images.T):
        for seen in (features, features[:, :9]):
            fitted = LinearReconstruction(clip=False).fit(seen, targets)
            ridge = ridge_readout().fit(seen, targets)
            np.testing.assert_allclose(fitted.predict(seen), ridge.predict(seen), atol=1e-9)
            assert fitted.alpha_ == ridge[-1].alpha_


def test_the_kernel_fit_is_kernel_ridge_on_centred_kernels() -> None:
    features, images = speckle()
    train, test = slice(0, 100), slice(100, None)
    fitted = KernelReconstruction(gammas=(0.3,), alphas=(0.1,), clip=False).fit(features[train], images[train])
    scaler = StandardScaler().fit(features[train])
    shots, others = scaler.transform(features[train]), scaler.transform(features[test])
    kernel = RBF(np.sqrt(60 / 2 / 0.3))
    middle = np.eye(100) - 0.01
    centred = middle @ kernel(shots) @ middle
    reference = KernelRidge(alpha=0.1 * np.trace(centred) / 100, kernel="precomputed")
    reference.fit(centred, images[train] - images[train].mean(axis=0))
    expected = reference.predict((kernel(others, shots) - kernel(shots).mean(axis=0)) @ middle)
    np.testing.assert_allclose(fitted.predict(features[test]), expected + images[train].mean(axis=0), atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_width_and_penalties_are_those_of_least_leave_one_out_error(seed: int) -> None:
    features, images = speckle(shots=30)
    settings = [(gamma, alpha) for gamma in GAMMAS for alpha in SHARES]
    value = images @ np.random.default_rng(seed).standard_normal(25)
    scaled = StandardScaler().fit_transform(features)  # features are standardised once, as in the closed form

    def left_out(gamma: float, alpha: float) -> float:
        kernel = RBF(np.sqrt(60 / 2 / gamma))(scaled)
        middle = np.eye(30) - 1 / 30
        penalty = alpha * np.trace(middle @ kernel @ middle) / 30
        # Dropping shot i from the bordered system of kernel ridge with a free bias.
        bordered = np.block([[kernel + penalty * np.eye(30), np.ones((30, 1))], [np.ones((1, 30)), np.zeros((1, 1))]])
        errors = []
        for shot in range(30):
            rest = np.delete(np.arange(31), shot)
            solution = np.linalg.solve(bordered[np.ix_(rest, rest)], np.append(np.delete(value, shot), 0))
            errors.append(value[shot] - bordered[shot, rest] @ solution)
        return float(np.mean(np.square(errors)))

    fitted = KernelReconstruction().fit(features, value)
    least = min(left_out(*pair) for pair in settings)
    assert left_out(fitted.gamma_, fitted.alphas_[0]) <= 1.01 * least


def test_noise_alone_gives_the_mean_image() -> None:
    generator = np.random.default_rng(5)
    features, images = generator.standard_normal((200, 20)), generator.integers(0, 2, (200, 9)).astype(float)
    for estimator in ESTIMATORS:
        predicted = clone(estimator).fit(features[:150], images[:150]).predict(features[150:])
        assert rmse(np.tile(images[:150].mean(axis=0), (50, 1)), predicted) < 0.1


def test_nothing_depends_on_the_images_that_are_asked_for_together() -> None:
    features, images = speckle()
    for estimator in ESTIMATORS:
        fitted = clone(estimator).fit(features[:100], images[:100])
        together = fitted.predict(features[100:])
        np.testing.assert_allclose([fitted.predict(one[np.newaxis])[0] for one in features[100:]], together, atol=1e-9)
