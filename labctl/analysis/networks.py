"""The paper's network that turns features into images; needs torch, the extra `imaging`, imported only on use."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import TYPE_CHECKING, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from sklearn.base import BaseEstimator, MultiOutputMixin, RegressorMixin
from sklearn.preprocessing import StandardScaler
from sklearn.utils.validation import check_is_fitted, validate_data

from labctl.errors import AnalysisError

if TYPE_CHECKING:
    import torch

HIDDEN = 200
"""Outputs of the first layer; two poolings by 2 leave a quarter of them."""
KERNELS = 10
"""Kernels of the first convolution."""


class ReconstructionNetwork(MultiOutputMixin, RegressorMixin, BaseEstimator):  # type: ignore[misc]  # no types there
    """Features to images through the network of the paper, about 1.2 million weights at 2500 features.

    Fully connected, features x 200; convolution of 10 kernels of size 3, ReLU, batch normalisation, maximum of each 2;
    convolution of 1 kernel of size 3, ReLU, batch normalisation, maximum of each 2; fully connected 50 x pixels and
    pixels x pixels. The convolutions are padded with zeros, which is what leaves 50. Inputs are standardised by mean
    and standard deviation of the training set; the loss is the mean squared error over all pixels. Source: the paper's
    methods, "Image reconstruction". The paper names neither optimiser nor batch nor epochs; here it is Adam with
    torch's defaults, its rate falling to zero along half a cosine, batches of 16 and 30 epochs, fixed for every
    experiment. Nothing is stopped early, so nothing is chosen on the test images of an experiment.

    On the CPU the same seed gives the same weights on one machine, bit for bit: training runs on one thread with
    deterministic algorithms. A GPU starts from the same weights and sees the shots in the same order, but rounds
    otherwise, so it ends elsewhere: ask for `device="cpu"` where results of several machines are to be compared.

    Args:
        epochs: Passes over the training set.
        batch_size: Shots in a batch; the last one of a pass may be smaller.
        learning_rate: Adam's rate in the first epoch.
        seed: Seed of the first weights and of the order of the shots.
        device: "auto" = a CUDA device where torch finds one, otherwise the CPU.
        clip: Limit predictions to the range of the training images; the paper mentions nothing of the kind.

    Attributes:
        network_: The trained torch module, on the CPU in double precision: features in, pixels out.
        losses_: (epochs,) mean training loss of each pass.
        device_: Where it was trained.
        range_: Least and greatest value in the training images.
        n_features_in_: Number of features.
    """

    def __init__(
        self,
        epochs: int = 30,
        batch_size: int = 16,
        learning_rate: float = 1e-3,
        seed: int = 0,
        device: Literal["auto", "cpu", "cuda"] = "auto",
        clip: bool = False,
    ) -> None:
        self.epochs = epochs
        self.batch_size = batch_size
        self.learning_rate = learning_rate
        self.seed = seed
        self.device = device
        self.clip = clip

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:  # noqa: N803  # scikit-learn's own name
        """Train on features (shots, features) and images (shots, pixels), or (shots,) values.

        Raises:
            AnalysisError: torch is missing, the device is not there, or a setting makes no sense.
        """
        features, images = validate_data(self, X, y, dtype=np.float64, multi_output=True, y_numeric=True)
        if self.epochs < 1 or self.batch_size < 1 or not self.learning_rate > 0:
            raise AnalysisError(
                f"{self.epochs} epochs in batches of {self.batch_size} at a rate of {self.learning_rate:g} train "
                "nothing: use numbers above zero"
            )
        self.device_ = _device(self.device)
        self._scaler = StandardScaler().fit(features)
        self._pixels = images.shape[1:]
        self.range_ = (float(images.min()), float(images.max()))
        targets = np.asarray(images, np.float32).reshape(len(images), -1)
        self.network_, self.losses_ = self._trained(self._scaler.transform(features).astype(np.float32), targets)
        return self

    def predict(self, X: ArrayLike) -> NDArray[np.float64]:  # noqa: N803
        """Images of features (shots, features), shaped as in training.

        In double precision on the CPU: an image does not depend on which others are asked for with it.
        """
        check_is_fitted(self)
        torch = _torch()
        features = self._scaler.transform(validate_data(self, X, dtype=np.float64, reset=False))
        with _repeatable(self.seed), torch.no_grad():
            images = self.network_(torch.from_numpy(np.ascontiguousarray(features))).numpy()
        shaped = np.asarray(images, np.float64).reshape(len(features), *self._pixels)
        return shaped.clip(*self.range_) if self.clip else shaped

    def _trained(
        self, features: NDArray[np.float32], images: NDArray[np.float32]
    ) -> tuple["torch.nn.Module", NDArray[np.float64]]:
        torch = _torch()
        with _repeatable(self.seed):
            network = _network(features.shape[1], images.shape[1]).to(self.device_)
            optimiser = torch.optim.Adam(network.parameters(), lr=self.learning_rate, fused=True)
            rate = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, self.epochs)
            inputs = torch.from_numpy(features).to(self.device_)
            targets = torch.from_numpy(images).to(self.device_)
            losses = np.zeros(self.epochs)
            for epoch in range(self.epochs):
                order = torch.randperm(len(features)).to(self.device_)
                for batch in order.split(self.batch_size):
                    optimiser.zero_grad()
                    loss = torch.nn.functional.mse_loss(network(inputs[batch]), targets[batch])
                    loss.backward()
                    optimiser.step()
                    losses[epoch] += loss.item() * len(batch) / len(features)
                rate.step()
        return network.cpu().double().eval(), losses


def _network(features: int, pixels: int) -> "torch.nn.Sequential":
    """The layers, their weights drawn by torch's defaults from its global generator."""
    from torch import nn

    return nn.Sequential(
        nn.Linear(features, HIDDEN),
        nn.Unflatten(1, (1, HIDDEN)),
        nn.Conv1d(1, KERNELS, 3, padding=1),
        nn.ReLU(),
        nn.BatchNorm1d(KERNELS),
        nn.MaxPool1d(2),
        nn.Conv1d(KERNELS, 1, 3, padding=1),
        nn.ReLU(),
        nn.BatchNorm1d(1),
        nn.MaxPool1d(2),
        nn.Flatten(),
        nn.Linear(HIDDEN // 4, pixels),
        nn.Linear(pixels, pixels),
    )


@contextmanager
def _repeatable(seed: int) -> Iterator[None]:
    """One thread, deterministic algorithms and a seeded generator; torch's own state is as before afterwards."""
    torch = _torch()
    threads, deterministic = torch.get_num_threads(), torch.are_deterministic_algorithms_enabled()
    warn_only = torch.is_deterministic_algorithms_warn_only_enabled()
    with torch.random.fork_rng(devices=()):  # a GPU's own generator is not used
        torch.set_num_threads(1)
        torch.use_deterministic_algorithms(mode=True)
        torch.default_generator.manual_seed(seed)
        try:
            yield
        finally:
            torch.use_deterministic_algorithms(deterministic, warn_only=warn_only)
            torch.set_num_threads(threads)


def _device(wanted: str) -> str:
    torch = _torch()
    if wanted not in ("auto", "cpu", "cuda"):
        raise AnalysisError(f"device '{wanted}' is unknown: use auto, cpu or cuda")
    if wanted == "cpu" or not torch.cuda.is_available():
        if wanted == "cuda":
            raise AnalysisError("torch finds no CUDA device: use device auto or cpu")
        return "cpu"
    os.environ.setdefault("CUBLAS_WORKSPACE_CONFIG", ":4096:8")  # without it CUDA's matrix products may vary
    return "cuda"


def _torch() -> ModuleType:
    try:
        import torch
    except ImportError as error:
        raise AnalysisError(
            "the reconstruction network needs torch, which is not installed: "
            'pip install "photonic-labctl[imaging]", or use LinearReconstruction'
        ) from error
    return torch
