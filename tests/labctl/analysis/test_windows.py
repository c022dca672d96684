import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.base import clone
from sklearn.exceptions import NotFittedError
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from labctl.analysis.windows import WindowFeatures, compressive_ratio, sample_count, wavelength_rows
from labctl.errors import AnalysisError
from labctl.runs.read.records import resample
from labctl.runs.read.run import volts

TAU = 40e-12


def records(shots: int = 3, ports: int = 5, samples: int = 60) -> np.ndarray:
    return np.random.default_rng(7).integers(-128, 128, (shots, ports, samples)).astype(np.int8)


@given(st.data())
def test_features_are_those_of_a_naive_loop(data: st.DataObject) -> None:
    recorded = data.draw(st.lists(st.integers(0, 14), min_size=1, max_size=6, unique=True))
    ports = data.draw(st.lists(st.sampled_from(recorded), min_size=1, unique=True))
    count, step, start = data.draw(st.integers(1, 12)), data.draw(st.integers(1, 3)), data.draw(st.integers(0, 9))
    frames = records(ports=len(recorded), samples=start + count * step)
    window = WindowFeatures(
        ports=tuple(ports),
        window_s=count * step * TAU,
        sample_interval_s=TAU,
        start_s=start * TAU,
        tau_s=step * TAU,
        recorded_ports=tuple(recorded),
    )
    expected = [
        [frame[recorded.index(port)][start + step * k] for port in ports for k in range(count)] for frame in frames
    ]
    features = window.fit_transform(frames)
    np.testing.assert_array_equal(features, expected)
    assert len(window.get_feature_names_out()) == features.shape[1]


WAVELENGTHS = (1550.0, 1551.0, 1552.0, 1553.0, 1554.0)


def test_further_wavelengths_are_further_columns() -> None:
    """Five ports at five wavelengths: 25 entries of the second axis, wavelength by wavelength."""
    ports, by_row = (2, 3, 4, 5, 6) * 5, np.repeat(WAVELENGTHS, 5)
    frames = records(ports=25)
    rows = wavelength_rows(WAVELENGTHS[:3], by_row)
    np.testing.assert_array_equal(rows, np.arange(15))
    np.testing.assert_array_equal(WindowFeatures().fit_transform(frames[:, rows]), frames[:, :15, :10].reshape(3, -1))
    np.testing.assert_array_equal(wavelength_rows([1554.0, 1551.00001], by_row), [20, 21, 22, 23, 24, 5, 6, 7, 8, 9])
    with pytest.raises(AnalysisError, match="nothing was measured at 1555 nm: choose from 1550, 1551, 1552, 1553"):
        wavelength_rows([1550.0, 1555.0], by_row)
    assert wavelength_rows([], by_row).size == 0
    every = WindowFeatures(recorded_ports=ports).fit(frames)
    np.testing.assert_array_equal(every.rows_, np.arange(25))
    np.testing.assert_array_equal(WindowFeatures(ports=ports).fit(frames).rows_, np.arange(25))


def test_a_port_recorded_at_several_wavelengths_is_used_at_all_of_them() -> None:
    frames = records(ports=6)
    window = WindowFeatures(ports=(4, 2), recorded_ports=(2, 3, 4, 2, 3, 4))
    features = window.fit_transform(frames)
    np.testing.assert_array_equal(features, frames[:, [2, 5, 0, 3], :10].reshape(3, -1))
    assert window.get_feature_names_out()[[0, 10, 20, 30]].tolist() == [
        f"port {port}, 0.000 ns" for port in (4, 4, 2, 2)
    ]


def test_without_ports_every_port_is_used() -> None:
    frames = records()
    np.testing.assert_array_equal(WindowFeatures().fit_transform(frames), frames[:, :, :10].reshape(3, 50))
    assert WindowFeatures(ports=(9, 8, 7, 6, 5)).fit(frames).get_feature_names_out()[10] == "port 8, 0.000 ns"


@pytest.mark.parametrize(("dtype", "expected"), [("i1", "f4"), ("i2", "f4"), ("f4", "f4"), ("f8", "f8")])
def test_codes_become_float32_and_doubles_stay(dtype: str, expected: str) -> None:
    assert WindowFeatures().fit_transform(records().astype(dtype)).dtype == np.dtype(expected)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"window_s": 2.44e-9}, "needs 61 samples, the records have 60"),
        ({"window_s": 2.4e-9, "start_s": 40e-12}, "use a shorter window or record longer"),
        ({"window_s": 0.3e-9}, r"use 0\.28 ns or 0\.32 ns"),
        ({"window_s": 0.01e-9}, r"samples: use 0\.04 ns$"),
        ({"window_s": -1e-9}, "must be above zero"),
        ({"window_s": np.inf}, "a window of inf s sampled every 4e-11 s has no end: use a shorter one"),
        ({"window_s": 1e300}, r"a window of 1e\+300 s sampled every 4e-11 s has no end"),
        ({"start_s": -1e-9}, "before the record"),
        ({"tau_s": 60e-12, "window_s": 0.6e-9}, "not a whole number of 0.04 ns samples"),
        ({"ports": (2, 3)}, "give recorded_ports"),
        ({"ports": (), "recorded_ports": (2, 3, 4, 5, 6)}, "no port is chosen"),
        ({"ports": (2, 9), "recorded_ports": (2, 3, 4, 5, 6)}, r"ports \[9\] were not recorded"),
    ],
)
def test_a_window_that_does_not_fit_says_what_to_do(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(AnalysisError, match=message):
        WindowFeatures(**arguments).fit(records())  # type: ignore[arg-type]


def test_records_must_be_shaped_like_those_of_fit() -> None:
    window = WindowFeatures().fit(records())
    with pytest.raises(AnalysisError, match="fitted on 5 x 60"):
        window.transform(records(samples=59))
    with pytest.raises(AnalysisError, match=r"\(shots, ports, samples\)"):
        window.transform(np.zeros((3, 60)))
    with pytest.raises(AnalysisError, match="not finite"):
        window.transform(np.full((1, 5, 60), np.nan))


def test_it_is_an_estimator_like_any_other() -> None:
    window = WindowFeatures(ports=(2, 3, 4, 5, 6), window_s=0.8e-9)
    copy = clone(window)
    assert copy is not window
    assert copy.get_params() == window.get_params()
    assert copy.set_params(window_s=0.4e-9).window_s == 0.4e-9
    assert window.window_s == 0.8e-9
    with pytest.raises(NotFittedError):
        window.transform(records())
    with pytest.raises(NotFittedError):
        window.get_feature_names_out()
    assert window.__sklearn_tags__().input_tags.three_d_array
    assert make_pipeline(window, StandardScaler()).fit_transform(records()).shape == (3, 100)


@pytest.mark.parametrize(("window_s", "count"), [(0.08e-9, 2), (0.4e-9, 10), (0.56e-9, 14), (2e-9, 50)])
def test_samples_of_the_papers_windows(window_s: float, count: int) -> None:
    assert sample_count(window_s, TAU) == count
    assert compressive_ratio(window_s, TAU) == count / 784


def test_volts_of_codes() -> None:
    frames = records(shots=2, ports=2, samples=3)
    converted = volts(frames, scale=[1e-3, 2e-3], offset=[0.5, -0.5])
    assert converted.dtype == np.float32
    np.testing.assert_allclose(converted[1, 1], 2e-3 * frames[1, 1] - 0.5, rtol=1e-6)


def band_limited(time: np.ndarray, *, highest: float = 0.8) -> np.ndarray:
    """Sum of sines up to `highest` of the Nyquist frequency of samples at 0, 1, 2, ..."""
    generator = np.random.default_rng(3)
    frequencies, phases = generator.uniform(0, highest / 2, 12), generator.uniform(0, 2 * np.pi, 12)
    return np.asarray(np.sin(2 * np.pi * frequencies * time[..., np.newaxis] + phases).sum(axis=-1))


def test_zero_offset_changes_nothing() -> None:
    frames = records()
    np.testing.assert_array_equal(resample(frames, np.zeros(3), sample_interval_s=TAU), frames)
    offsets = np.array([0.0, 10e-12, 0.0])
    mixed = resample(frames, offsets, sample_interval_s=TAU)
    np.testing.assert_array_equal(mixed[[0, 2]], frames[[0, 2]])
    assert np.any(mixed[1] != frames[1])


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4))
def test_a_band_limited_signal_is_put_on_the_triggers_grid(shifts: list[float]) -> None:
    shift = np.array(shifts).reshape(2, 2)
    samples = np.arange(100.0)
    taken = band_limited(samples + shift[..., np.newaxis])
    moved = resample(taken, shift * TAU, sample_interval_s=TAU)
    expected = np.broadcast_to(band_limited(samples), taken.shape)
    inside = slice(17, -17)
    np.testing.assert_allclose(moved[..., inside], expected[..., inside], atol=0.01)


def test_one_offset_a_shot_serves_all_its_ports() -> None:
    frames = records().astype(np.float64)
    offsets = np.array([5e-12, -10e-12, 20e-12])
    np.testing.assert_array_equal(
        resample(frames, offsets, sample_interval_s=TAU),
        resample(frames, np.repeat(offsets[:, np.newaxis], 5, axis=1), sample_interval_s=TAU),
    )


def test_many_records_are_moved_like_one(monkeypatch: pytest.MonkeyPatch) -> None:
    generator = np.random.default_rng(1)
    frames, offsets = generator.normal(size=(7, 2, 20)), generator.uniform(-40e-12, 40e-12, (7, 2))
    offsets[3] = 0
    together = resample(frames, offsets, sample_interval_s=40e-12)
    monkeypatch.setattr("labctl.runs.read.records.BLOCK_SAMPLES", 2 * 2 * 20)
    np.testing.assert_array_equal(resample(frames, offsets, sample_interval_s=40e-12), together)


@given(st.floats(-1, 1), st.integers(1, 40))
def test_a_constant_stays_a_constant_up_to_the_ends(shift: float, samples: int) -> None:
    moved = resample(np.full((1, 1, samples), 5.0), [shift * TAU], sample_interval_s=TAU)
    np.testing.assert_allclose(moved, 5.0, rtol=1e-12)


def test_offsets_that_do_not_fit_are_refused() -> None:
    with pytest.raises(AnalysisError, match=r"offsets have shape \(2,\)"):
        resample(records(), np.zeros(2), sample_interval_s=TAU)
    with pytest.raises(AnalysisError, match="more than one sample"):
        resample(records(), np.array([0, 0, 1e-9]), sample_interval_s=TAU)
