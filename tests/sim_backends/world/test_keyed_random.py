import numpy as np
import pytest

from sim_backends.world.keyed_random import Purpose, Rekeyed, digest, generator
from sim_backends.world.world import World


def test_generators_are_named_by_their_purpose() -> None:
    world = World(twin_seed=1)
    draws = {world.generator(*purpose).random() for purpose in (("a",), ("a", 1), ("a", "1"), (b"a",), ("a1",))}
    assert len(draws) == 5
    assert world.generator("a", 1).random() == World(twin_seed=1).generator("a", 1).random()
    assert world.generator("a").random() != World(twin_seed=2).generator("a").random()


def test_digests_tell_types_and_borders_apart() -> None:
    names: list[tuple[Purpose, ...]] = [
        ("ab", "c"),
        ("a", "bc"),
        ("abc",),
        (b"abc",),
        (1,),
        (1.0,),
        ("1",),
        (True, 2),
        (1, 2, ""),
    ]
    assert len({digest(*name) for name in names}) == len(names)


def test_a_rekeyed_generator_starts_anew_with_every_key() -> None:
    rekeyed = Rekeyed()
    keys = [digest(number) for number in (1, 2, 1)]
    for key in keys:
        drawn, expected = rekeyed.generator(key), generator(key)
        assert drawn.standard_normal(3, np.float32).tolist() == expected.standard_normal(3, np.float32).tolist()
        assert drawn.random(5).tolist() == expected.random(5).tolist()


def test_noise_of_a_key_is_the_same_however_many_keys_there_are() -> None:
    keys = [digest(number) for number in range(5)]
    together = Rekeyed().unit_noise(keys, (2, 300))
    assert np.array_equal(together[3], Rekeyed().unit_noise(keys[3:4], (2, 300))[0])
    assert len(np.unique(together)) > 2900
    assert together.std() == pytest.approx(1.0, abs=0.05)
