"""What the protocol asks of a bench, without one."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from protocols.base import Images, ProtocolError, Seeds, Shot, ShotKind
from protocols.image_readout import ImageReadout, balanced_order
from protocols.patterns import Patterns


def images(count: int = 40, side: int = 28, classes: int = 4) -> Images:
    generator = np.random.default_rng(0)
    return Images(generator.random((count, side, side)) < 0.2, np.arange(count) % classes, np.arange(100, 100 + count))


class TestSettings:
    def test_text_with_units_is_understood(self) -> None:
        protocol = ImageReadout.model_validate(
            {"window": "0.4 ns", "ports": "2-4,6", "wavelengths": "1550 nm, 1551 nm", "classes": "0,1"}
        )
        assert protocol.window == 0.4e-9
        assert protocol.ports == (2, 3, 4, 6)
        assert protocol.wavelengths == (1550.0, 1551.0)
        assert protocol.classes == (0, 1)
        assert protocol.sample_count(images()) == 10

    @pytest.mark.parametrize(
        "settings",
        [
            {"window": "0.4 V"},
            {"window": -1e-9},
            {"ports": "2,2"},
            {"ports": "2-x"},
            {"ports": "15"},
            {"images": 0},
            {"averages": 0},
            {"colour": "red"},
        ],
    )
    def test_what_cannot_be_is_refused(self, settings: dict[str, object]) -> None:
        with pytest.raises(ValidationError):
            ImageReadout.model_validate(settings)

    def test_the_digest_follows_every_setting(self) -> None:
        assert ImageReadout().digest() == ImageReadout().digest()
        variants = [ImageReadout(seed=2), ImageReadout(ports=(2,)), ImageReadout(averages=4)]
        assert len({ImageReadout().digest(), *(variant.digest() for variant in variants)}) == 4

    def test_seeds_of_their_own_count_where_there_are_some(self) -> None:
        assert ImageReadout(seed=2).seeds == (2, 2, 2)
        assert ImageReadout(seed=2, image_seed=3, drive_seed=5).seeds == Seeds(images=3, order=2, drive=5)
        variants = [ImageReadout(image_seed=1), ImageReadout(order_seed=1), ImageReadout(drive_seed=1)]
        assert len({ImageReadout().digest(), *(variant.digest() for variant in variants)}) == 4

    def test_it_survives_json(self) -> None:
        protocol = ImageReadout(ports=(2, 3), window=1e-9)
        assert ImageReadout.model_validate_json(protocol.model_dump_json()) == protocol


class TestShots:
    def test_every_image_once_with_references_and_darkness_between(self) -> None:
        shots = ImageReadout(images=40).shots(images())
        kinds = [shot.kind for shot in shots]
        assert kinds.count(ShotKind.IMAGE) == 40
        assert kinds.count(ShotKind.REFERENCE) == kinds.count(ShotKind.DARK) == 2
        assert [shot.index for shot in shots] == list(range(44))
        shown = [shot.dataset_index for shot in shots if shot.kind is ShotKind.IMAGE]
        assert sorted(shown) == list(range(100, 140))
        assert len({shot.dataset_index for shot in shots if shot.kind is ShotKind.REFERENCE}) == 1

    def test_repeats_of_one_image_share_a_group(self) -> None:
        shots = ImageReadout(images=40).shots(images())
        reference = next(shot for shot in shots if shot.kind is ShotKind.REFERENCE)
        assert reference.group == next(s.group for s in shots if s.dataset_index == reference.dataset_index)

    def test_the_seed_fixes_the_order(self) -> None:
        assert ImageReadout(seed=3).shots(images()) == ImageReadout(seed=3).shots(images())
        assert ImageReadout(seed=3).shots(images()) != ImageReadout(seed=4).shots(images())

    @given(st.lists(st.integers(1, 30), min_size=1, max_size=5), st.integers(0, 100))
    def test_no_class_runs_ahead_of_another(self, sizes: list[int], seed: int) -> None:
        labels = np.repeat(np.arange(len(sizes)), sizes)
        order = balanced_order(labels, np.random.default_rng(seed))
        assert sorted(order) == list(range(labels.size))
        for label, size in enumerate(sizes):
            progress = np.cumsum(labels[order] == label) / size
            even = np.arange(1, labels.size + 1) / labels.size
            assert np.max(np.abs(progress - even)) < len(sizes) / min(sizes) + 1e-9


class TestPatterns:
    def shot(self, kind: ShotKind = ShotKind.IMAGE, index: int = 100) -> Shot:
        return Shot(0, kind, index, 0, index)

    def test_pixels_become_whole_squares_of_mirrors_in_the_middle(self) -> None:
        source = images()
        mirrors = np.unpackbits(Patterns(source, (768, 1024))[self.shot()], axis=1)
        assert mirrors.shape == (768, 1024)
        middle = mirrors[6:762, 134:890]
        assert np.array_equal(middle[::27, ::27].astype(bool), source.images[0])
        assert np.array_equal(middle, np.kron(source.images[0], np.ones((27, 27), np.uint8)))
        assert mirrors.sum() == middle.sum()

    def test_darkness_turns_every_mirror_away(self) -> None:
        assert not Patterns(images(), (768, 1024))[self.shot(ShotKind.DARK, -1)].any()

    def test_images_larger_than_the_dmd_are_refused(self) -> None:
        with pytest.raises(ProtocolError, match="800x800 pixels do not fit a DMD of 768x1024"):
            Patterns(images(4, 800), (768, 1024))
