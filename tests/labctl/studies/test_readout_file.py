from pathlib import Path

import h5py
import numpy as np
import pytest
from sklearn.base import clone
from sklearn.datasets import load_digits
from sklearn.exceptions import NotFittedError
from sklearn.linear_model import Lasso, LogisticRegression
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler

from labctl.analysis.anomaly import CovarianceScore, NormalityScore
from labctl.analysis.readouts import softmax_classifier, softmax_readout
from labctl.analysis.reconstruction import KernelReconstruction, LinearReconstruction
from labctl.analysis.regression import ridge_readout
from labctl.analysis.windows import WindowFeatures
from labctl.errors import AnalysisError
from labctl.runs.format.global_heaps import HEAP
from labctl.studies.readout_file import load_metadata, load_model, save_model


@pytest.fixture(scope="module")
def digits() -> tuple[np.ndarray, np.ndarray]:
    images, labels = load_digits(return_X_y=True)
    return images.reshape(-1, 8, 8)[:600].astype(np.int8), labels[:600]


@pytest.fixture(scope="module")
def readout(digits: tuple[np.ndarray, np.ndarray]) -> Pipeline:
    frames, labels = digits
    readout = softmax_readout(ports=range(1, 9), window_s=0.28e-9, sample_interval_s=40e-12, start_s=40e-12)
    return readout.fit(frames[:500], labels[:500])


def test_a_loaded_readout_predicts_the_same(
    readout: Pipeline, digits: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    frames, _ = digits
    path = tmp_path / "readout.h5"
    metadata = {"run": "20230215-image-readout", "window_s": np.float64(0.28e-9), "ports": np.arange(1, 9)}
    save_model(path, readout, metadata)
    loaded = load_model(path)
    # The last digit of a BLAS product depends on where in memory its factors lie.
    np.testing.assert_allclose(loaded.predict_proba(frames), readout.predict_proba(frames), rtol=1e-12)
    assert [name for name, _ in loaded.steps] == [name for name, _ in readout.steps]
    assert load_metadata(path) == {**metadata, "window_s": 0.28e-9, "ports": list(range(1, 9))}
    assert [file.name for file in tmp_path.iterdir()] == ["readout.h5"]
    save_model(path, loaded, {})
    np.testing.assert_array_equal(load_model(path).predict(frames), readout.predict(frames))


def test_class_names_may_be_text(digits: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    frames, labels = digits
    names = np.array(["null", "eins", "zwei", "drei", "vier", "fünf", "sechs", "sieben", "acht", "neun"])[labels]
    flat = frames.reshape(-1, 64)
    classifier = softmax_classifier().fit(flat, names)
    save_model(tmp_path / "text.h5", classifier, {})
    assert load_model(tmp_path / "text.h5").predict(flat).tolist() == classifier.predict(flat).tolist()


@pytest.mark.parametrize("outputs", [1, 3])
def test_a_regression_comes_back(digits: tuple[np.ndarray, np.ndarray], tmp_path: Path, outputs: int) -> None:
    flat = digits[0].reshape(-1, 64)
    targets = flat[:, 20] * 0.5 if outputs == 1 else flat[:, 20 : 20 + outputs] ** 2
    readout = ridge_readout(alphas=[0.1, 10.0, 1000.0]).fit(flat[:, :20], targets)
    save_model(tmp_path / "ridge.h5", readout, {})
    loaded = load_model(tmp_path / "ridge.h5")
    np.testing.assert_allclose(loaded.predict(flat[:, :20]), readout.predict(flat[:, :20]), rtol=1e-12)
    assert loaded[-1].alpha_ == readout[-1].alpha_
    assert clone(loaded).fit(flat[:, :20], targets)[-1].alpha_ == readout[-1].alpha_


@pytest.mark.parametrize("score", [NormalityScore(alpha=0.1), CovarianceScore(), CovarianceScore(shrinkage=0.5)])
def test_an_anomaly_score_comes_back(
    digits: tuple[np.ndarray, np.ndarray], tmp_path: Path, score: NormalityScore | CovarianceScore
) -> None:
    frames, labels = digits
    readout = make_pipeline(WindowFeatures(window_s=0.32e-9), score).fit(frames[labels == 0])
    save_model(tmp_path / "score.h5", readout, {})
    loaded = load_model(tmp_path / "score.h5")
    np.testing.assert_allclose(loaded.score_samples(frames), readout.score_samples(frames), rtol=1e-12)
    assert loaded[-1].get_params() == score.get_params()


@pytest.mark.parametrize(
    "estimator", [LinearReconstruction(alphas=(0.1, 10.0), clip=False), KernelReconstruction(gammas=(0.1, 0.3))]
)
@pytest.mark.parametrize("pixels", [1, 16])
def test_a_reconstruction_comes_back(
    digits: tuple[np.ndarray, np.ndarray],
    tmp_path: Path,
    estimator: LinearReconstruction | KernelReconstruction,
    pixels: int,
) -> None:
    frames = digits[0][:200]
    images = frames.reshape(-1, 64)[:, 24 : 24 + pixels].astype(np.float64)
    readout = make_pipeline(WindowFeatures(window_s=0.16e-9), clone(estimator))
    readout.fit(frames, images if pixels > 1 else images[:, 0])
    save_model(tmp_path / "images.h5", readout, {})
    loaded = load_model(tmp_path / "images.h5")
    np.testing.assert_allclose(loaded.predict(frames), readout.predict(frames), rtol=1e-9, atol=1e-9)
    assert loaded[-1].get_params() == estimator.get_params()


def test_settings_other_than_the_defaults_come_back(digits: tuple[np.ndarray, np.ndarray], tmp_path: Path) -> None:
    frames, labels = digits
    flat = frames.reshape(-1, 64)
    pipeline = make_pipeline(StandardScaler(with_std=False), LogisticRegression(C=0.5, max_iter=2000)).fit(flat, labels)
    save_model(tmp_path / "other.h5", pipeline, {})
    loaded = load_model(tmp_path / "other.h5")
    assert loaded.get_params()["logisticregression__C"] == 0.5
    assert loaded.get_params()["standardscaler__with_std"] is False
    np.testing.assert_allclose(loaded.predict_proba(flat), pipeline.predict_proba(flat), rtol=1e-12)


def test_what_has_no_file_format_is_refused(
    readout: Pipeline, digits: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    frames, labels = digits
    path = tmp_path / "no.h5"
    with pytest.raises(AnalysisError, match="class Lasso cannot be saved"):
        save_model(path, make_pipeline(StandardScaler(), Lasso()).fit(frames.reshape(-1, 64), labels), {})
    with pytest.raises(NotFittedError):
        save_model(path, softmax_classifier(), {})
    with pytest.raises(AnalysisError, match="cannot be saved with a readout"):
        save_model(path, readout, {"path": path})
    dates = softmax_classifier().fit(frames.reshape(-1, 64), np.array(labels, "datetime64[D]"))
    with pytest.raises(AnalysisError, match="use numbers or text as class labels"):
        save_model(path, dates, {})
    assert not path.exists()


def test_files_that_are_no_readouts_are_refused(readout: Pipeline, tmp_path: Path) -> None:
    path = tmp_path / "file.h5"
    with pytest.raises(AnalysisError, match="cannot be read as HDF5"):
        load_model(path)
    path.write_text("not HDF5")
    with pytest.raises(AnalysisError, match="cannot be read as HDF5"):
        load_model(path)
    with h5py.File(path, "w"):
        pass
    with pytest.raises(AnalysisError, match="not a readout"):
        load_metadata(path)


@pytest.mark.parametrize("version", ["1.2", "2.0", "1.1.1", "x", ""])
def test_a_newer_format_is_refused(readout: Pipeline, tmp_path: Path, version: str) -> None:
    path = tmp_path / "newer.h5"
    save_model(path, readout, {})
    with h5py.File(path, "a") as file:
        file.attrs["format_version"] = version
    with pytest.raises(AnalysisError, match="update labctl"):
        load_model(path)


def test_an_unknown_class_in_a_file_is_never_made(readout: Pipeline, tmp_path: Path) -> None:
    path = tmp_path / "unknown.h5"
    save_model(path, readout, {})
    with h5py.File(path, "a") as file:
        file["standardscaler"].attrs["estimator"] = np.bytes_("FunctionTransformer")
    with pytest.raises(AnalysisError, match="unknown class 'FunctionTransformer'"):
        load_model(path)


def test_labels_and_metadata_of_any_length_come_back_and_lie_in_no_heap(
    digits: tuple[np.ndarray, np.ndarray], tmp_path: Path
) -> None:
    frames, labels = digits
    names = np.array(["null", "eins", "größer als eins"])[np.minimum(labels, 2)]
    readout = softmax_classifier().fit(frames.reshape(-1, 64), names)
    path, metadata = tmp_path / "named.h5", {"text": "ä" * 100_000}
    save_model(path, readout, metadata)
    assert HEAP not in path.read_bytes()
    assert load_metadata(path) == metadata
    assert load_model(path).classes_.tolist() == sorted(set(names))
