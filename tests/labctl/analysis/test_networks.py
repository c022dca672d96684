import sys
from typing import Any

import numpy as np
import pytest
from sklearn.utils.estimator_checks import parametrize_with_checks

from labctl.analysis.networks import ReconstructionNetwork
from labctl.analysis.regression import rmse
from labctl.errors import AnalysisError

torch = pytest.importorskip("torch", reason="needs the extra imaging")


def squares(shots: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """One of two bars in a 4 x 4 image, and 30 quadratic measurements."""
    generator = np.random.default_rng(2)
    images = np.zeros((shots, 4, 4))
    images[np.arange(shots), generator.integers(0, 4, shots)] = 1
    fields = generator.standard_normal((30, 16))
    return (images.reshape(shots, 16) @ fields.T) ** 2, images.reshape(shots, 16)


@parametrize_with_checks([ReconstructionNetwork(epochs=5, learning_rate=0.01, device="cpu")])  # type: ignore[untyped-decorator]
def test_the_estimator_keeps_to_scikit_learn(estimator: object, check: object) -> None:
    check(estimator)  # type: ignore[operator]


def test_the_layers_are_the_papers() -> None:
    features, images = np.random.default_rng(0).random((4, 250)), np.random.default_rng(1).random((4, 784))
    network = ReconstructionNetwork(epochs=1).fit(features, images).network_
    shapes = {name: tuple(value.shape) for name, value in network.named_parameters() if "weight" in name}
    kinds = [type(layer).__name__ for layer in network.children()]
    assert list(shapes.values()) == [(200, 250), (10, 1, 3), (10,), (1, 10, 3), (1,), (784, 50), (784, 784)]
    block = ["Conv1d", "ReLU", "BatchNorm1d", "MaxPool1d"]
    assert kinds == ["Linear", "Unflatten", *block, *block, "Flatten", "Linear", "Linear"]


def test_it_learns_images() -> None:
    features, images = squares()
    trained = ReconstructionNetwork(epochs=60).fit(features[:120], images[:120])
    assert trained.losses_.shape == (60,)
    assert trained.losses_[-1] < 0.2 * trained.losses_[0]
    mean_image = rmse(images[120:], np.tile(images[:120].mean(axis=0), (30, 1)))
    assert rmse(images[120:], trained.predict(features[120:])) < 0.5 * mean_image


def test_limits_hold_only_where_they_are_asked_for() -> None:
    features, images = squares()
    free, clipped = (ReconstructionNetwork(epochs=5, clip=clip).fit(features, images) for clip in (False, True))
    assert free.predict(features).min() < 0
    np.testing.assert_array_equal(free.predict(features).clip(0, 1), clipped.predict(features))


def test_the_same_seed_gives_the_same_bytes_and_another_one_does_not() -> None:
    features, images = squares()
    torch.manual_seed(99)  # what the caller did with torch's own generator is of no account
    first = ReconstructionNetwork(epochs=3, seed=4).fit(features, images).predict(features)
    torch.rand(5)
    second = ReconstructionNetwork(epochs=3, seed=4).fit(features, images).predict(features)
    other = ReconstructionNetwork(epochs=3, seed=5).fit(features, images).predict(features)
    assert first.tobytes() == second.tobytes()
    assert np.abs(first - other).max() > 1e-3


def test_torch_is_left_as_it_was_found() -> None:
    features, images = squares(40)
    torch.manual_seed(7)
    expected = torch.rand(3)
    torch.manual_seed(7)
    threads = torch.get_num_threads()
    ReconstructionNetwork(epochs=1).fit(features, images).predict(features)
    assert torch.equal(torch.rand(3), expected)
    assert torch.get_num_threads() == threads
    assert not torch.are_deterministic_algorithms_enabled()


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"epochs": 0}, "0 epochs"),
        ({"batch_size": 0}, "batches of 0"),
        ({"learning_rate": 0.0}, "rate of 0"),
        ({"device": "tpu"}, "use auto, cpu or cuda"),
    ],
)
def test_settings_that_make_no_sense_are_refused(settings: dict[str, Any], text: str) -> None:
    with pytest.raises(AnalysisError, match=text):
        ReconstructionNetwork(**settings).fit(*squares(20))


def test_the_device_is_a_gpu_only_where_there_is_one() -> None:
    chosen = ReconstructionNetwork(epochs=1).fit(*squares(20)).device_
    assert chosen == ("cuda" if torch.cuda.is_available() else "cpu")
    if not torch.cuda.is_available():
        with pytest.raises(AnalysisError, match="no CUDA device"):
            ReconstructionNetwork(device="cuda").fit(*squares(20))


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no GPU here")
def test_a_gpu_repeats_itself_and_ends_near_the_cpu() -> None:
    features, images = squares()
    cuda, again = (
        ReconstructionNetwork(epochs=3, device="cuda").fit(features, images).predict(features) for _ in range(2)
    )
    cpu = ReconstructionNetwork(epochs=3, device="cpu").fit(features, images).predict(features)
    assert cuda.tobytes() == again.tobytes()
    np.testing.assert_allclose(cuda, cpu, atol=0.02)


def test_without_torch_one_line_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(AnalysisError, match=r"photonic-labctl\[imaging\]") as caught:
        ReconstructionNetwork().fit(*squares(20))
    assert "\n" not in str(caught.value)
