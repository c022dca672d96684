import numpy as np
import pytest

from labctl import datasets
from labctl.analysis import baselines
from labctl.analysis.splits import Split, random_splits
from labctl.errors import AnalysisError


@pytest.fixture(scope="module")
def digits() -> tuple[np.ndarray, np.ndarray, list[Split]]:
    chosen = datasets.load("mnist-0-3", images=400, seed=2)
    return chosen.images, chosen.labels, list(random_splits(chosen.labels, np.arange(400), splits=3, seed=1))


def sines(length: int) -> np.ndarray:
    steps = np.arange(length)
    return np.asarray(np.sin(0.3 * steps) + 0.5 * np.cos(1.1 * steps))


def logistic_map(length: int) -> np.ndarray:
    values = [0.3]
    while len(values) < length:
        values.append(3.9 * values[-1] * (1 - values[-1]))
    return np.array(values)


def test_more_mask_rows_let_the_numerical_network_see_more(digits: tuple[np.ndarray, np.ndarray, list[Split]]) -> None:
    images, labels, splits = digits
    few, many = (
        baselines.numerical_network_accuracy(images, labels, splits, rows=rows, hidden=50, seed=0) for rows in (10, 50)
    )
    assert few.shape == (3,)
    assert 0.5 < few.mean() < many.mean() - 0.05
    assert many.mean() > 0.8


def test_the_numerical_network_is_that_of_its_seed(digits: tuple[np.ndarray, np.ndarray, list[Split]]) -> None:
    images, labels, splits = digits
    first, again, other = (
        baselines.numerical_network(images, labels, splits, rows=8, hidden=5, seed=seed) for seed in (3, 3, 4)
    )
    np.testing.assert_array_equal(first.confusion, again.confusion)
    assert not np.array_equal(first.confusion, other.confusion)
    assert first.confusion.sum() == 3 * 40


def test_raw_pixels_are_recognised(digits: tuple[np.ndarray, np.ndarray, list[Split]]) -> None:
    images, labels, splits = digits
    assert baselines.raw_pixel_accuracy(images, labels, splits).mean() > 0.85


def test_pixels_beyond_full_scale_are_refused(digits: tuple[np.ndarray, np.ndarray, list[Split]]) -> None:
    images, labels, splits = digits
    with pytest.raises(AnalysisError, match="binarise"):
        baselines.raw_pixel_accuracy(images.astype(float) * 255, labels, splits)


def test_dark_cracks_are_counted_and_bright_ones_stand_out_from_the_normal() -> None:
    generator = np.random.default_rng(0)
    shares = np.where(np.arange(200) < 100, 0.5, 0.3)
    images = generator.random((200, 20, 20)) < shares[:, np.newaxis, np.newaxis]
    abnormal = np.arange(200) >= 100
    dark, inverted = baselines.dark_share(images), baselines.dark_share(~images)
    assert baselines.dark_pixels(dark, abnormal).auc > 0.99
    assert baselines.dark_pixels(inverted, abnormal).auc < 0.01
    assert baselines.dark_pixels(inverted, abnormal, normal=inverted[:50]).auc > 0.99


def test_the_mean_image_is_that_of_the_training_images() -> None:
    images = np.array([[[0, 0], [1, 1]], [[0, 1], [1, 0]], [[1, 1], [1, 1]]])
    error = baselines.mean_image_rmse(images, [(np.array([0, 1]), np.array([2]))])
    np.testing.assert_allclose(error, [np.sqrt((1 + 0.25 + 0 + 0.25) / 4)])


def test_four_past_values_predict_two_sines() -> None:
    series = sines(400)
    assert baselines.autoregressive_nmse(series, order=4, train=200, test=100) < 1e-20
    assert baselines.autoregressive_nmse(series, order=2, train=200, test=100) > 1e-3


def test_nothing_after_the_tested_steps_is_looked_at_and_nothing_tested_is_trained_on() -> None:
    series = logistic_map(400)
    altered = series.copy()
    altered[301:] = 0  # step 299, the last one tested, is of value 300
    kwargs = {"train": 200, "test": 100}
    assert baselines.autoregressive_nmse(series, **kwargs) == baselines.autoregressive_nmse(altered, **kwargs)
    longest = baselines.autoregressive_nmse(series, order=5, **kwargs)
    assert longest == pytest.approx(_by_hand(series, order=5, **kwargs))


def _by_hand(series: np.ndarray, order: int, train: int, test: int) -> float:
    rows = np.array([[1, *series[step - order + 1 : step + 1]] for step in range(order - 1, train + test)])
    targets = series[order : train + test + 1]
    weights = np.linalg.lstsq(rows[: train - order + 1], targets[: train - order + 1])[0]
    wanted = targets[-test:]
    return float(np.mean((rows[-test:] @ weights - wanted) ** 2) / np.var(wanted))


def test_an_echo_state_network_predicts_what_a_line_cannot() -> None:
    series = logistic_map(700)
    linear = baselines.autoregressive_nmse(series, train=400, test=200)
    echo, again, other = (
        baselines.echo_state_nmse(series, nodes=60, train=400, test=200, seed=seed) for seed in (1, 1, 2)
    )
    assert linear > 0.5
    assert echo < 0.01
    assert echo == again != other


@pytest.mark.parametrize("length", [0, 300])
def test_a_series_that_is_too_short_is_refused(length: int) -> None:
    with pytest.raises(AnalysisError, match="need a series of 301"):
        baselines.autoregressive_nmse(np.ones(length), train=200, test=100)
    with pytest.raises(AnalysisError, match="need a series of 301"):
        baselines.echo_state_nmse(np.ones(length), nodes=3, train=200, test=100, seed=0)


def test_settings_that_leave_nothing_to_train_on_are_refused() -> None:
    with pytest.raises(AnalysisError, match="order 200"):
        baselines.autoregressive_nmse(sines(400), order=200, train=200, test=100)
    with pytest.raises(AnalysisError, match="200 of 200"):
        baselines.echo_state_nmse(sines(400), nodes=3, train=200, test=100, seed=0, washout=200)


def test_the_vowel_network_draws_the_line_that_no_plane_can() -> None:
    generator = np.random.default_rng(4)
    features = generator.uniform(-1, 1, (300, 2))
    labels = (features[:, 0] * features[:, 1] > 0).astype(int)
    splits = list(random_splits(labels, np.arange(300), splits=2, test_size=0.5, seed=0))
    assert baselines.vowel_network_accuracy(features, labels, splits, seed=0).min() > 0.85
