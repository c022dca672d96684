from dataclasses import replace

import numpy as np
import pytest

from labctl.runs.format.shape import RunShape


def test_ports_follow_the_passes(small: RunShape) -> None:
    assert small.ports == (2, 3, 4, 5, 6)
    assert small.pass_of_port.tolist() == [0, 0, 0, 0, 1]
    assert [small.columns(0), small.columns(1)] == [slice(0, 4), slice(4, 5)]
    np.testing.assert_allclose(small.time[:3], [-40e-12, -20e-12, 0])


def test_every_port_has_the_wavelength_of_its_pass(small: RunShape) -> None:
    assert small.wavelength_of_port == (0.0,) * 5
    assert replace(small, wavelengths_nm=(1550.0, 1551.0)).wavelength_of_port == (1550.0,) * 4 + (1551.0,)


@pytest.mark.parametrize(
    "wrong",
    [{"shots": 0}, {"samples": 0}, {"passes": ()}, {"passes": ((),)}, {"passes": ((2,), (2,))}, {"code_type": "int32"}],
)
def test_impossible_shapes_are_refused(small: RunShape, wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"a run needs|a port is|code_type"):
        replace(small, **wrong)  # type: ignore[arg-type]
