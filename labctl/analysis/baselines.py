"""What the bench is compared with: the same tasks solved on the images and series themselves, without any light."""

from collections.abc import Iterable, Sequence
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.dummy import DummyRegressor
from sklearn.linear_model import LinearRegression
from sklearn.neural_network import MLPClassifier
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from labctl.analysis.anomaly import Roc, roc
from labctl.analysis.evaluation import CrossValidation, validate, validate_softmax
from labctl.analysis.kernel import KernelClassifier
from labctl.analysis.regression import nmse, ridge_readout, rmse
from labctl.analysis.splits import Split
from labctl.analysis.threads import one_thread
from labctl.errors import AnalysisError

MAX_ITERATIONS = 5000


def hidden_layer_classifier(
    hidden: int,
    *,
    activation: Literal["tanh", "relu"] = "tanh",
    solver: Literal["lbfgs", "adam"] = "lbfgs",
    penalty: float = 1.0,
    seed: int,
) -> Pipeline:
    """One fully connected hidden layer, then softmax, on standardised features.

    Args:
        hidden: Neurons of the hidden layer.
        activation: Of the hidden layer.
        solver: "lbfgs" takes the whole training set at once, "adam" batches of 200.
        penalty: On |W|^2 / 2, as in `softmax_classifier`; the paper names none.
        seed: Seed of the first weights and of Adam's batches.
    """
    network = MLPClassifier(
        (hidden,), activation=activation, solver=solver, alpha=penalty, max_iter=MAX_ITERATIONS, random_state=seed
    )
    return make_pipeline(StandardScaler(), network)


def numerical_network(
    images: NDArray[Any], labels: NDArray[Any], splits: Iterable[Split], *, rows: int, hidden: int, seed: int
) -> CrossValidation:
    """The paper's numerical neural network: a Gaussian mask for the optics, a trained tanh layer and softmax after it.

    The masks are rows x pixels independent normal numbers, one draw for all splits; there is no noise. The paper says
    N x 784 rows and as many neurons as the bench has features; only M N rows give the accuracy that it calls
    comparable, so print both.

    Args:
        images: (n, ...) pixels, 0..1 or bool.
        labels: (n,) class of each image.
        splits: Training and test positions.
        rows: Rows of the mask, N or M N.
        hidden: Neurons of the tanh layer, M N.
        seed: Seed of the mask and of the first weights.
    """
    pixels = _pixels(images)
    mask = np.random.default_rng(seed).standard_normal((rows, pixels.shape[1]))
    readout = hidden_layer_classifier(hidden, seed=seed)
    return validate(pixels @ mask.T, labels, splits, readout=readout)


def numerical_network_accuracy(
    images: NDArray[Any], labels: NDArray[Any], splits: Iterable[Split], *, rows: int, hidden: int, seed: int
) -> NDArray[np.float64]:
    """Accuracy (splits,) of `numerical_network`."""
    return numerical_network(images, labels, splits, rows=rows, hidden=hidden, seed=seed).scores


def raw_pixel_accuracy(images: NDArray[Any], labels: NDArray[Any], splits: Iterable[Split]) -> NDArray[np.float64]:
    """Accuracy (splits,) of multinomial logistic regression, C = 1, on the pixels of the images (n, ...).

    The pixels are not standardised: all have one scale, and a pixel that is hardly ever lit would be blown up, which
    costs about a point.
    """
    return validate_softmax(_pixels(images), labels, splits, spreads=_unit).scores


def kernel_of_pixels_accuracy(
    images: NDArray[Any], labels: NDArray[Any], splits: Iterable[Split], *, landmarks: int, seed: int
) -> NDArray[np.float64]:
    """Accuracy (splits,) of a `KernelClassifier` on the pixels of the images (n, ...), not standardised either."""
    readout = KernelClassifier(landmarks, seed=seed)
    return validate(_pixels(images), labels, splits, readout=readout).scores


def dark_share(images: NDArray[Any]) -> NDArray[np.float64]:
    """Share (n,) of the pixels of each image (n, ...) that are dark: 0 of pixels 0..1 or bool."""
    pixels = np.asarray(images)
    if pixels.dtype != np.bool_:
        pixels = _pixels(pixels)
    lit: NDArray[np.float64] = pixels.reshape(len(pixels), -1).mean(axis=1, dtype=np.float64)
    return 1 - lit


def dark_pixels(dark: NDArray[np.float64], abnormal: ArrayLike, *, normal: NDArray[np.float64] | None = None) -> Roc:
    """Cracks found by their share of dark pixels, what one detector and no fibre could do.

    Args:
        dark: (n,) `dark_share` of each image.
        abnormal: (n,) True where the image shows a crack.
        normal: (m,) of normal training images: the score is then how far a share is from their mean, either way,
            for binarisation rules that make cracks bright. None = the share itself, more is more abnormal.
    """
    return roc(dark if normal is None else np.abs(dark - normal.mean()), abnormal)


def mean_image_rmse(images: NDArray[Any], splits: Iterable[Split]) -> NDArray[np.float64]:
    """RMSE (splits,) on the test images of answering the mean training image to everything; images (n, ...)."""
    pixels = _pixels(images)
    errors = []
    for train, test in splits:
        mean = DummyRegressor().fit(pixels[train], pixels[train])
        errors.append(rmse(pixels[test], mean.predict(pixels[test])))
    return np.array(errors)


def autoregressive_nmse(series: ArrayLike, *, order: int = 10, train: int, test: int) -> float:
    """NMSE one step ahead of least squares on the last `order` values and a bias.

    Predictions 0..train - 1 are trained on, the next `test` ones are tested. Prediction n is of value n + 1, as in
    `one_step_ahead`; the first `order` - 1 lack a full past and are left out.

    Raises:
        AnalysisError: The series is too short, or the settings leave nothing to train on.
    """
    values = _series(series, train, test)
    if not 1 <= order < train:
        raise AnalysisError(f"order {order} with {train} training steps: use an order from 1 to below that")
    past = np.lib.stride_tricks.sliding_window_view(values[:-1], order)
    targets = values[order:]
    last = train - order + 1  # the first prediction is number order - 1
    model = LinearRegression().fit(past[:last], targets[:last])
    return nmse(targets[last : last + test], model.predict(past[last : last + test]))


def echo_state_nmse(
    series: ArrayLike,
    *,
    nodes: int = 1000,
    train: int,
    test: int,
    seed: int,
    spectral_radius: float = 0.9,
    input_scale: float = 1.0,
    washout: int = 100,
) -> float:
    """NMSE one step ahead of an echo-state network in numbers, same steps as `autoregressive_nmse`.

    x(n) = tanh(W x(n - 1) + w u(n) + b), u the series scaled to -1..1 by its training part, and a ridge readout of x.
    W is dense with normal elements of variance spectral_radius^2 / nodes: its eigenvalues fill the disc of that radius
    (Girko's circular law). w and b are uniform. Source: Jaeger, GMD report 148 (2001).

    Args:
        series: (n,) values.
        nodes: Nodes of the network.
        train: Training steps.
        test: Test steps, following.
        seed: Seed of W, w and b.
        spectral_radius: Of W.
        input_scale: w is uniform in -input_scale..input_scale, b likewise.
        washout: First training steps that are left out, while the network forgets its start.

    Raises:
        AnalysisError: The series is too short, or the settings leave nothing to train on.
    """
    values = _series(series, train, test)
    if nodes < 1 or not 0 <= washout < train:
        raise AnalysisError(f"{nodes} nodes and {washout} of {train} training steps left out: nothing is trained")
    generator = np.random.default_rng(seed)
    recurrent = generator.standard_normal((nodes, nodes)) * (spectral_radius / np.sqrt(nodes))
    weights, bias = generator.uniform(-input_scale, input_scale, (2, nodes))
    low, high = values[:train].min(), values[:train].max()
    inputs = 2 * (values[:-1] - low) / max(high - low, np.finfo(float).tiny) - 1
    states = np.zeros((train + test, nodes))
    state = np.zeros(nodes)
    with one_thread():
        for step in range(train + test):
            state = np.tanh(recurrent @ state + weights * inputs[step] + bias)
            states[step] = state
        readout = ridge_readout().fit(states[washout:train], values[washout + 1 : train + 1])
        return nmse(values[train + 1 : train + test + 1], readout.predict(states[train:]))


def vowel_network_accuracy(
    features: NDArray[Any], labels: NDArray[Any], splits: Iterable[Split], *, hidden: int = 100, seed: int
) -> NDArray[np.float64]:
    """Accuracy (splits,) of the paper's digital network for vowels: one layer of ReLU neurons trained with Adam.

    On the features (n, features) themselves; the penalty is scikit-learn's default, 1e-4.
    """
    readout = hidden_layer_classifier(hidden, activation="relu", solver="adam", penalty=1e-4, seed=seed)
    return validate(features, labels, splits, readout=readout).scores


def _pixels(images: NDArray[Any]) -> NDArray[np.float32]:
    """Images (n, ...) as (n, pixels) numbers.

    Raises:
        AnalysisError: Pixels are not 0..1.
    """
    pixels = np.asarray(images, np.float32).reshape(len(images), -1)
    if not pixels.size or pixels.min() < 0 or pixels.max() > 1:
        raise AnalysisError("pixels are not 0 to 1: binarise the images as they are shown, or divide by the full scale")
    return pixels


def _unit(features: NDArray[np.floating], splits: Sequence[Split]) -> NDArray[np.float64]:
    """What is not standardised is in the penalty as it is."""
    return np.ones((len(splits), features.shape[1]))


def _series(series: ArrayLike, train: int, test: int) -> NDArray[np.float64]:
    values = np.asarray(series, np.float64)
    if values.ndim != 1 or train < 1 or test < 1 or values.size < train + test + 1:
        raise AnalysisError(
            f"{train} training and {test} test steps need a series of {train + test + 1} values, not {values.shape}"
        )
    return values[: train + test + 1]
