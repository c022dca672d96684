import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from labctl.analysis.symbols import one_step_ahead, require_causal, symbol_features
from labctl.errors import AnalysisError
from labctl.runs.read.records import resample

SLOT = 80e-12
SAMPLE = 20e-12


def records(shots: int = 2, ports: int = 3, samples: int = 60) -> np.ndarray:
    return np.random.default_rng(7).integers(-128, 128, (shots, ports, samples)).astype(np.int8)


@given(st.data())
def test_features_are_the_samples_of_a_symbols_own_slot(data: st.DataObject) -> None:
    slot = data.draw(st.sampled_from([1, 2, 4, 6]))
    per_symbol = data.draw(st.sampled_from([n for n in (1, 2, 3, 4, 6) if slot % n == 0]))
    symbols = data.draw(st.integers(1, 8))
    rounding = data.draw(st.sampled_from([0.0, 1e-9]))  # far from the tolerance, at which either sample is right
    first = data.draw(st.integers(0, 800)) / 100 + rounding
    frames = records(samples=60)
    features = symbol_features(
        frames,
        first_s=first * SAMPLE,
        symbol_s=slot * SAMPLE,
        symbols=symbols,
        per_symbol=per_symbol,
        sample_interval_s=SAMPLE,
    )
    assert features.shape == (2, symbols, 3 * per_symbol)
    for symbol in range(symbols):
        earliest = [first + symbol * slot + j * slot / per_symbol for j in range(per_symbol)]
        taken = [next(k for k in range(60) if k >= time - 1e-6) for time in earliest]
        assert max(taken) < first + (symbol + 1) * slot
        np.testing.assert_array_equal(features[:, symbol], frames[:, :, taken].reshape(2, -1))


@given(st.integers(1, 9), st.floats(0, 200e-12))
def test_no_feature_changes_with_a_later_symbol(boundary: int, first_s: float) -> None:
    settings = {"first_s": first_s, "symbol_s": SLOT, "symbols": 10, "per_symbol": 4, "sample_interval_s": SAMPLE}
    frames = records()
    changed = frames.copy()
    changed[:, :, int(np.ceil(first_s / SAMPLE - 1e-6)) + 4 * boundary :] += 1
    before, after = symbol_features(frames, **settings), symbol_features(changed, **settings)  # type: ignore[arg-type]
    np.testing.assert_array_equal(after[:, :boundary], before[:, :boundary])
    assert np.all(after[:, boundary:] != before[:, boundary:])


def test_rounding_never_reaches_for_the_next_symbol() -> None:
    """0.1 ns + 3 x 80 ps is a hair above a whole number of samples in binary."""
    frames = np.arange(4000.0).reshape(1, 1, -1)
    features = symbol_features(
        frames, first_s=5 * SAMPLE, symbol_s=SLOT, symbols=900, per_symbol=4, sample_interval_s=SAMPLE
    )
    np.testing.assert_array_equal(features.ravel(), np.arange(5, 3605))


def test_every_shot_and_port_may_have_its_own_arrival() -> None:
    frames = np.broadcast_to(np.arange(60), (2, 3, 60))
    arrivals = np.array([[0, 0.5, 1], [2, 2.5, 3]]) * SAMPLE
    settings = {"symbol_s": SLOT, "symbols": 2, "per_symbol": 1, "sample_interval_s": SAMPLE}
    each = symbol_features(frames, first_s=arrivals, **settings)  # type: ignore[arg-type]
    np.testing.assert_array_equal(each[:, 0], [[0, 1, 1], [2, 3, 3]])
    by_shot = symbol_features(frames, first_s=arrivals[:, 0], **settings)  # type: ignore[arg-type]
    np.testing.assert_array_equal(by_shot[:, 1], [[4, 4, 4], [6, 6, 6]])
    with pytest.raises(AnalysisError, match=r"arrival times have shape \(3,\)"):
        symbol_features(frames, first_s=np.zeros(3), **settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"symbol_s": 70e-12}, "is 3.5 samples of 20 ps"),
        ({"symbol_s": 80.2e-12}, "whole multiple of the symbol rate"),
        ({"symbol_s": 0.0}, "must be above zero"),
        ({"symbols": 0}, "must be above zero"),
        ({"per_symbol": 3}, "use a divisor of 4"),
        ({"per_symbol": 0}, "use a divisor of 4"),
        ({"symbols": 16}, "need samples 0 to 63, the records have 60"),
        ({"first_s": -1e-12 * 21}, "record from before the first symbol"),
    ],
)
def test_slots_that_do_not_fit_say_what_to_do(arguments: dict[str, float], message: str) -> None:
    settings = {"first_s": 0.0, "symbol_s": SLOT, "symbols": 10, "per_symbol": 4, "sample_interval_s": SAMPLE}
    with pytest.raises(AnalysisError, match=message):
        symbol_features(records(), **settings | arguments)  # type: ignore[arg-type]
    with pytest.raises(AnalysisError, match=r"expected \(shots, ports, samples\)"):
        symbol_features(np.zeros((3, 4)), **settings)  # type: ignore[arg-type]


def test_windows_that_reach_into_the_next_symbol_are_found_out() -> None:
    slots = {"first_s": 35e-12, "symbol_s": SLOT, "symbols": 12, "sample_interval_s": SAMPLE}

    def honest(frames: np.ndarray) -> np.ndarray:
        return symbol_features(frames, per_symbol=4, **slots)  # type: ignore[arg-type]

    def late(frames: np.ndarray) -> np.ndarray:
        return symbol_features(frames, per_symbol=4, **slots | {"first_s": 50e-12})  # type: ignore[arg-type]

    def interpolated(frames: np.ndarray) -> np.ndarray:
        return honest(resample(frames, np.full(2, 5e-12), sample_interval_s=SAMPLE))

    frames = records(samples=60)
    require_causal(honest, frames, **slots)  # type: ignore[arg-type]
    require_causal(honest, np.zeros_like(frames), **slots)  # type: ignore[arg-type]
    for leaking in (late, interpolated):
        with pytest.raises(AnalysisError, match="before the light of the next one"):
            require_causal(leaking, frames, **slots)  # type: ignore[arg-type]


def test_one_step_ahead() -> None:
    inputs, targets = one_step_ahead([1, 4, 9, 16])
    assert (inputs.tolist(), targets.tolist()) == ([1, 4, 9], [4, 9, 16])
    with pytest.raises(AnalysisError, match="two or more"):
        one_step_ahead([1])
