"""From volts to codes: effective bits, range and position."""

import numpy as np
import pytest

from sim_backends.optics.receiver import digitiser_noise_codes
from sim_backends.virtual.dpo72504dx.digitiser import quantised
from sim_backends.virtual.dpo72504dx.vertical import Vertical


def vertical(offset_v: float = 0.0, position_div: float = 0.0) -> Vertical:
    return Vertical(scale_v=0.1, offset_v=offset_v, position_div=position_div, inverted=False)


@pytest.mark.parametrize("enob", [4.5, 5.5, 7.0])
def test_effective_bits(enob: float) -> None:
    generator = np.random.default_rng(1)
    volts = generator.uniform(-0.4, 0.4, 200_000).astype(np.float32)
    noise = generator.standard_normal(volts.size, dtype=np.float32) * np.float32(digitiser_noise_codes(enob))
    error = quantised(volts, noise, vertical()) * (0.1 / 25) - volts
    assert error.std() == pytest.approx(1.024 / 2**enob / np.sqrt(12), rel=0.01)


def test_scale_offset_position_and_clipping() -> None:
    volts = np.array([[0.1, 0.2], [9.0, -9.0]], np.float32)
    codes = quantised(volts, np.zeros_like(volts), vertical(offset_v=0.1, position_div=-2.0))
    assert codes.dtype == np.int8
    assert codes.tolist() == [[-50, -25], [127, -128]]
    assert volts[1, 0] == 9.0, "what was measured stays as it was"
