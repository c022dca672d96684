"""Patterns and images beside a reference: what is shown, in which order, and that its light adds up."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from instruments.bench import Bench
from labctl.bench.opening import opened
from labctl.bench.station import Station, WiringSection
from labctl.engine.inputs import images_for
from protocols.base import Images, PassStarted, ProtocolError, Record, ShotKind
from protocols.dynamic_scene import DynamicScene
from protocols.ghost_imaging import GhostImaging
from protocols.reference_picture import beside_reference, field_of, random_patterns

SMALL = {"images": 4, "patterns": 6, "ports": (2,), "reference_every": 5}


@given(st.integers(0, 1000), st.integers(1, 20))
def test_picture_and_reference_never_share_a_mirror(seed: int, side: int) -> None:
    fields = np.random.default_rng(seed).random((2, side, side)) < 0.5
    alone, beside = beside_reference(fields, reference=False), beside_reference(fields, reference=True)
    reference = beside_reference(np.zeros_like(fields), reference=True)
    assert not np.any(alone & reference)
    assert np.array_equal(alone | reference, beside)
    assert alone.sum() == 3 * fields.sum()
    assert reference[0].sum() == 3 * ((side + 8) ** 2 - side**2)


def test_random_patterns_are_half_on_and_fixed_by_the_seed() -> None:
    patterns = random_patterns(3, 30, (20, 20))
    assert np.all(patterns.sum(axis=(1, 2)) == 200)
    assert np.array_equal(patterns, random_patterns(3, 30, (20, 20)))
    assert not np.array_equal(patterns, random_patterns(4, 30, (20, 20)))
    alike = np.mean(patterns[:, 1:] == patterns[:, :-1], axis=(1, 2))
    assert alike.min() < 0.6 < 0.8 < alike.max(), "from single pixels to large grains"


def test_everything_is_shown_beside_the_reference_and_alone() -> None:
    protocol = GhostImaging(**SMALL)
    inputs = images_for(protocol)
    shots = protocol.shots(inputs)
    kinds = [shot.kind for shot in shots]
    assert [shot.index for shot in shots] == list(range(len(shots)))
    assert kinds.count(ShotKind.REFERENCE) == kinds.count(ShotKind.DARK) == 2
    for beside, alone, count in (
        (ShotKind.PATTERN, ShotKind.PATTERN_ALONE, 6),
        (ShotKind.IMAGE, ShotKind.IMAGE_ALONE, 4),
    ):
        places = [place for place, kind in enumerate(kinds) if kind is beside]
        assert [kinds[place + 1] for place in places] == [alone] * count
        assert all(shots[place].group == shots[place + 1].group for place in places)
    assert {shot.group for shot in shots if shot.kind is ShotKind.PATTERN} == set(range(6))
    assert {shot.dataset_index for shot in shots if shot.kind is ShotKind.IMAGE} == set(inputs.indices.tolist())


def test_images_under_the_reference_are_refused(bench: Bench, log: Any) -> None:
    small = Images(np.ones((4, 8, 8), bool), np.zeros(4, np.int64), np.arange(4))
    with pytest.raises(ProtocolError, match="lie under the reference"):
        GhostImaging(**SMALL).check(bench, small)
    assert not log.messages


def test_a_frame_of_a_burst_that_would_last_into_the_next_picture_is_refused(log: Any) -> None:
    """After a pulse of 20 us the drive plays two windows before the frame; a picture lasts 44 us."""
    with opened(Station(wiring=WiringSection(burst=True)), log) as found:
        inputs = images_for(GhostImaging(**SMALL))
        GhostImaging(**SMALL, timing="burst", window=8e-6).check(found.bench, inputs)
        GhostImaging(**SMALL, timing="software", window=14e-6).check(found.bench, inputs)
        with pytest.raises(
            ProtocolError, match=r"^window = 14 us: .* end 62 us after .* lasts 44 us: choose a shorter"
        ):
            GhostImaging(**SMALL, timing="burst", window=14e-6).check(found.bench, inputs)
        assert not log.sent_to("laser")


def test_what_beats_with_the_reference_adds_up_pixel_by_pixel(log: Any) -> None:
    """Four pictures, two of them the halves of the third: on the wire the beats of the halves are that of the whole.

    Behind an amplifier that does not saturate: one that does gives less to the whole.
    """
    with opened(Station().with_parameters({"amplifier_saturation_w": 1e3}), log) as found:
        _beats_add_up(found.bench)


def _beats_add_up(bench: Bench) -> None:
    whole = np.zeros((3, 28, 28), bool)
    whole[:, 4:24, 4:24] = random_patterns(1, 1, (20, 20))
    whole[0, :, 14:] = whole[1, :, :14] = False
    inputs = Images(whole, np.zeros(3, np.int64), np.arange(3))
    protocol = GhostImaging(**SMALL | {"patterns": 2, "averages": 256, "window": 2e-9})
    events = list(protocol.acquire(bench, inputs, protocol.parts(bench, inputs)))
    (started,) = (event for event in events if isinstance(event, PassStarted))
    records = [event for event in events if isinstance(event, Record)]
    shots = protocol.shots(inputs)

    def volts(kind: ShotKind, group: int) -> np.ndarray:
        own = [r.frames.codes[0, 0] for r in records if (shots[r.first].kind, shots[r.first].group) == (kind, group)]
        return np.asarray(np.mean(own, axis=0) * started.scalings[0].scale_v)

    reference, dark = volts(ShotKind.REFERENCE, -1), volts(ShotKind.DARK, -1)
    alone = [volts(ShotKind.IMAGE_ALONE, image) - dark for image in range(3)]
    beats = [volts(ShotKind.IMAGE, image) - reference - alone[image] for image in range(3)]
    assert np.std(beats[0] + beats[1] - beats[2]) < 0.15 * np.std(beats[2])
    assert np.std(alone[0] + alone[1] - alone[2]) > 0.3 * np.std(alone[2]), "intensities alone do not add up"


def test_a_scene_sees_the_masks_of_the_still_images(bench: Bench) -> None:
    imaging = GhostImaging(**SMALL, window=10e-9)
    scene = DynamicScene(images=8, scenes=1, reference=True, repeats_after=10e-9)
    inputs = images_for(scene)
    drive = scene.drive(bench, inputs)
    assert np.array_equal(drive.samples, imaging.drive(bench, inputs).samples)
    assert drive.samples.size == 2500
    assert np.array_equal(drive.samples[:250], drive.samples[250:500])


def test_only_the_middle_is_shown() -> None:
    images = np.arange(28 * 28).reshape(1, 28, 28) % 2 == 0
    assert field_of(images).shape == (1, 20, 20)
    assert np.array_equal(field_of(images)[0], images[0, 4:24, 4:24])
