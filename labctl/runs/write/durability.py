"""How much of a run may be lost when its process dies."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Durability:
    """When a shard closes, whichever comes first: so much is lost at most when the process dies.

    Attributes:
        shots: shots of one pass.
        seconds: age of the oldest shot that is not on disk yet, by the wall.
        shard_bytes: bytes of samples.

    Raises:
        ValueError: one of them is not above zero.
    """

    shots: int = 20
    seconds: float = 1.0
    shard_bytes: int = 64_000_000

    def __post_init__(self) -> None:
        if self.shots < 1 or not self.seconds > 0 or self.shard_bytes < 1:
            raise ValueError(f"{self}: shots, seconds and shard_bytes must be above zero")

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> "Durability":
        """From the entry `durability` of a manifest; keys of later minor versions are ignored.

        Raises:
            ValueError, TypeError: it is no such entry.
        """
        if not all(type(values[name]) in (int, float) for name in cls.__dataclass_fields__ if name in values):
            raise ValueError("durability is given in numbers")
        return cls(**{name: values[name] for name in cls.__dataclass_fields__ if name in values})
