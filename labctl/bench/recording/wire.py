"""What becomes of the messages of every bench that a command opens: passed on, recorded, or answered by a recording."""

import hashlib
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field

VARIABLE = "LABCTL_WIRE"
"""How a command that is started in a process of its own learns of it."""


class RecordingRequest(BaseModel):
    """Where to record, whether to mask, and the command that is recorded."""

    model_config = ConfigDict(frozen=True)

    path: Path
    mask: bool
    command: tuple[str, ...]


class Played(BaseModel):
    """A recording that is played: its name and the SHA-256 of the file."""

    model_config = ConfigDict(frozen=True)

    name: str
    sha256: str

    @classmethod
    def of(cls, path: Path) -> Self:
        """Of the recording in `path`."""
        with path.open("rb") as file:
            return cls(name=path.name, sha256=hashlib.file_digest(file, "sha256").hexdigest())


class Wire(BaseModel):
    """What is between the drivers and their instruments: nothing but the network, unless one of these is set.

    Attributes:
        record: What every bench writes a recording of itself for, if it does.
        replay: VISA addresses that answer as recorded, by the bench (`bench_of` its station) and the instrument; None
            where nothing is played.
        played: The recordings that these answers come from.
        differed: Whether what is played has ended with a difference, and so for good; of this process only.
    """

    model_config = ConfigDict(frozen=True)

    record: RecordingRequest | None = None
    replay: Mapping[str, Mapping[str, str]] | None = None
    played: tuple[Played, ...] = ()
    differed: Callable[[], bool] = Field(default=lambda: False, exclude=True)

    def __reduce__(self) -> tuple[Callable[[Any], Self], tuple[Any]]:
        """Other processes get it without `differed`, which they cannot ask."""
        return type(self).model_validate, (self.model_dump(),)

    @classmethod
    def of_this_process(cls) -> Self:
        """As the parent of this process said in its `environment`."""
        return cls.model_validate_json(os.environ.get(VARIABLE, "{}"))

    def environment(self) -> dict[str, str]:
        """What the environment of a child must have to open its benches in the same way."""
        return {VARIABLE: self.model_dump_json(exclude_none=True)}
