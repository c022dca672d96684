import pytest

from labctl.runs.write.durability import Durability


@pytest.mark.parametrize("wrong", [{"shots": 0}, {"seconds": 0.0}, {"seconds": float("nan")}, {"shard_bytes": 0}])
def test_a_durability_of_nothing_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="above zero"):
        Durability(**wrong)  # type: ignore[arg-type]


def test_durability_ignores_keys_of_later_versions() -> None:
    assert Durability.from_json({"shots": 5, "seconds": 2.0, "log": True}) == Durability(5, 2.0)
