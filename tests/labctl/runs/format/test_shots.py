from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from labctl.runs.format.shots import Durability, RunShape, ShotColumns


def test_ports_follow_the_passes(small: RunShape) -> None:
    assert small.ports == (2, 3, 4, 5, 6)
    assert [small.columns(0), small.columns(1)] == [slice(0, 4), slice(4, 5)]
    np.testing.assert_allclose(small.time[:3], [-40e-12, -20e-12, 0])


@pytest.mark.parametrize(
    "wrong",
    [{"shots": 0}, {"samples": 0}, {"passes": ()}, {"passes": ((),)}, {"passes": ((2,), (2,))}, {"code_type": "int32"}],
)
def test_impossible_shapes_are_refused(small: RunShape, wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match="RunShape"):
        replace(small, **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [{"shots": 0}, {"seconds": 0.0}, {"seconds": float("nan")}, {"shard_bytes": 0}])
def test_a_durability_of_nothing_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="above zero"):
        Durability(**wrong)  # type: ignore[arg-type]


def test_durability_ignores_keys_of_later_versions() -> None:
    assert Durability.from_json({"shots": 5, "seconds": 2.0, "log": True}) == Durability(5, 2.0)


def test_columns_of_different_lengths_are_refused(small: RunShape, plan_for: Callable[[RunShape], ShotColumns]) -> None:
    with pytest.raises(ValueError, match="column label"):
        replace(plan_for(small), label=np.zeros(3, np.int64)).table()


def test_an_unknown_kind_is_refused(small: RunShape, plan_for: Callable[[RunShape], ShotColumns]) -> None:
    with pytest.raises(ValueError, match="flat-field"):
        replace(plan_for(small), kind=np.full(small.shots, "flat-field")).table()
