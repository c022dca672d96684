from typing import Any

import pytest
from pydantic import ValidationError

from sim_backends.optics import derived
from sim_backends.parameters import Parameters


@pytest.mark.parametrize("name", list(Parameters.model_fields))
def test_every_parameter_has_unit_and_reason(name: str) -> None:
    field = Parameters.model_fields[name]
    assert not field.is_required()
    assert field.description
    assert isinstance(field.json_schema_extra, dict)
    assert field.json_schema_extra["unit"]


def test_defaults_are_the_bench() -> None:
    bench = Parameters()
    assert derived.fibre_v_number(bench) == pytest.approx(158, abs=0.2)
    assert derived.launched_modes(bench) == 675
    assert derived.collection_modes(bench) == 129
    assert derived.delay_spread_s(bench) == pytest.approx(0.395e-9, rel=0.01)
    assert derived.grain_superpixels(bench) == pytest.approx(4.42, abs=0.01)
    assert derived.grain_superpixels(Parameters(launch_profile="filled")) == pytest.approx(4.29, abs=0.02)
    assert derived.mode_density_per_hz(bench) == pytest.approx(0.99e-9, rel=0.01)
    assert (bench.enob, bench.mirror_leaves_s, bench.mirror_arrives_s) == (5.5, 0.5e-6, 1.5e-6)


def test_full_aperture_gives_long_spread_and_fine_grain_together() -> None:
    full = Parameters(launch_na=0.39)
    assert derived.delay_spread_s(full) == pytest.approx(3.56e-9, rel=0.01)
    assert 0.8 < derived.grain_superpixels(full) < 1.6
    assert derived.launched_modes(full) == pytest.approx(6250, rel=0.01)


def test_light_is_late_by_leads_and_by_the_fibre_it_goes_through() -> None:
    assert Parameters().light_delay_s == 98e-9
    assert Parameters(fibre_length_m=40.0).light_delay_s == pytest.approx(98e-9 + 97.57e-9, abs=0.01e-9)
    for length_m in (20.0, 40.0):
        direct = Parameters(light_path="direct", fibre_length_m=length_m)
        assert direct.light_delay_s == pytest.approx(1.666e-9, abs=1e-12)


@pytest.mark.parametrize(
    "wrong",
    [
        {"launch_na": 0.5},
        {"mirror_arrives_s": 0.1e-6},
        {"chip_input_port": 15},
        {"collected_modes": 3, "collecting_modes": 2},
        {"enob": 9.0},
        {"unknown": 1.0},
    ],
)
def test_impossible_values_are_refused(wrong: Any) -> None:
    with pytest.raises(ValidationError):
        Parameters(**wrong)


def test_frozen() -> None:
    with pytest.raises(ValidationError):
        Parameters().enob = 8.0  # type: ignore[misc]
