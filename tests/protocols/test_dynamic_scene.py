"""Scenes: when the light of a simulated bench says that the image changed, and which moments no bench can give."""

from typing import Any

import numpy as np
import pytest

from labctl.bench.opening import opened
from labctl.bench.station import Station, WiringSection
from labctl.engine.inputs import images_for
from protocols.base import ProtocolError, Record
from protocols.dynamic_scene import DynamicScene
from sim_backends.optics.mirrors import moved_fraction
from sim_backends.parameters import Parameters

TRUTH = Parameters()
QUIET = {
    "detector_nep_w_per_rthz": 1e-16,
    "enob": 7.0,
    "trigger_jitter_s": 0.0,
    "awg_jitter_s": 0.0,
    "laser_rin_db_per_hz": -250.0,
    "amplifier_noise_figure_db": 3.0,
}
WIRED = Station(wiring=WiringSection(burst=True)).with_parameters(QUIET)
PERIOD, SEEN = 2500, 50
"""Samples of the drive's period, and of what is looked at in each."""
TAU_S = 40e-12


def switch_seen_s(codes: np.ndarray) -> float:
    """When the switch was commanded, s after the first sample, by the one scene of codes (ports, samples).

    Between the images the light is a square form of how far the mirrors are, which the data sheet says: of all moments
    the one that leaves the least of the light unexplained.
    """
    starts = np.arange(0, codes.shape[1] - SEEN, PERIOD)
    light = np.stack([codes[:, start : start + SEEN].ravel() for start in starts]).astype(np.float64)
    middle_s = (starts + SEEN / 2) * TAU_S

    def unexplained(moment_s: float) -> float:
        moved = moved_fraction(middle_s - moment_s, leaves=TRUTH.mirror_leaves_s, arrives=TRUTH.mirror_arrives_s)
        terms = np.stack([np.ones_like(moved), moved, moved**2], axis=1)
        return float(np.sum((light - terms @ np.linalg.lstsq(terms, light, rcond=None)[0]) ** 2))

    moments_s = np.arange(0.2e-6, codes.shape[1] * TAU_S - 1.6e-6, 10e-9)
    return float(moments_s[np.argmin([unexplained(moment) for moment in moments_s])])


@pytest.mark.parametrize("switch_after", [4.6e-6, 2.5e-6])
def test_the_light_changes_when_it_was_asked_to(switch_after: float, log: Any) -> None:
    protocol = DynamicScene(
        images=40, scenes=1, ports=(2, 3, 4, 5), switch_after=switch_after, window=switch_after + 2.4e-6
    )
    images = images_for(protocol)
    with opened(WIRED, log) as found:
        events = list(protocol.acquire(found.bench, images, protocol.parts(found.bench, images)))
    (record,) = (event for event in events if isinstance(event, Record))
    assert switch_seen_s(record.frames.codes[0]) == pytest.approx(switch_after, abs=30e-9)


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"switch_after": 4.63e-6}, r"switch_after = 4\.63 us: .* repeats after 100 ns the switch comes at 4\.6 us"),
        ({"switch_after": 1.2345e-6, "repeats_after": 0.4e-9}, r"comes at 1\.2344 us: choose that"),
        (
            {"switch_after": 5e-6, "repeats_after": 20e-6},
            "plays for 40 us before the record, and a picture lasts 44 us",
        ),
        (
            {"repeats_after": 0.5e-9},
            r"repeats_after = 0\.5 ns is not a whole number of 0\.04 ns samples: use 0\.48 ns or",
        ),
    ],
)
def test_a_moment_that_no_pulse_gives_is_refused_in_the_dark(settings: dict[str, float], told: str, log: Any) -> None:
    protocol = DynamicScene(images=40, scenes=1, **settings)
    images = images_for(protocol)
    with opened(WIRED, log) as found, pytest.raises(ProtocolError, match=told):
        protocol.check(found.bench, images)
    assert not log.messages


@pytest.mark.parametrize(("switch_after", "repeats_after"), [(0.5e-6, 10e-9), (1e-6, 0.56e-9), (3e-6, 20e-6)])
def test_a_drive_that_repeats_otherwise_is_led_by_whole_periods(
    switch_after: float, repeats_after: float, log: Any
) -> None:
    protocol = DynamicScene(images=40, scenes=1, switch_after=switch_after, repeats_after=repeats_after)
    images = images_for(protocol)
    with opened(WIRED, log) as found:
        lead_s = protocol._lead_s(found.bench.dmd, protocol.drive(found.bench, images))  # type: ignore[arg-type]
    pulse_us = 44 - (lead_s + switch_after) * 1e6
    assert pulse_us == pytest.approx(round(pulse_us), abs=1e-5)
    assert lead_s / repeats_after == pytest.approx(round(lead_s / repeats_after), abs=1e-6)
