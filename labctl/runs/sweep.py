"""sweep.json: what a sweep is declared as, and which runs in its folder are its points."""

import hashlib
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, NonNegativeInt, ValidationError

from instruments.toml_files import describe
from labctl.errors import RunError
from labctl.runs.format.own_files import read_own
from labctl.runs.said import Said
from labctl.runs.sweep_axes import Order, measuring_order, points_of, with_reference

FILE = "sweep.json"
LARGEST = 1 << 22
WITHOUT_MICRO = ("1.0", "1.1", "1.2")
"""Versions of the file whose runs have no micro sign in their names."""
DIGEST = "sha256"
"""Key of the file: the digest of all else in it, by which an edited one is known. Those before 1.4 have none."""
LONGEST_NAME = 80
MICRO = "[\u00b5\u03bc]"
"""As keyboards write it, and as the Greek letter."""
_Value = Annotated[str, Field(coerce_numbers_to_str=True)]


class Sweep(BaseModel):
    """A protocol with settings, and what they are varied over.

    over: values of each axis, which is a setting of the protocol or a key of the station such as "laser.power". zip:
    whether the axes go side by side instead of in every combination. order, seed: in which order points are measured.
    reference_every: the first point is measured first, last and after so many others; 0: once. micro: what a micro sign
    is in the names of runs.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    protocol: str
    settings: dict[str, Any] = {}
    over: dict[str, Annotated[tuple[_Value, ...], Field(min_length=1)]] = Field(min_length=1)
    zip: bool = False
    order: Order = Order.RANDOM
    seed: NonNegativeInt = 1
    reference_every: NonNegativeInt = 10
    micro: str = Field("u", pattern="^u?$", exclude=True)


class SweepFile(BaseModel):
    """What sweep.json holds.

    The sweep; by file and content its station, and its protocol if a file defines it; `said` of each of its runs; where
    its runs are, if not beside it, and what the manifest of each says then, but for what is varied.
    """

    model_config = ConfigDict(frozen=True)

    format: str = Field("labctl-sweep", pattern="^labctl-sweep$")
    format_version: str = "1.4"
    sweep: Sweep
    station: str
    station_sha256: str
    protocol_file: str = ""
    protocol_sha256: str = ""
    said: Said = Said()
    store: str = ""
    of_each: dict[str, Any] = {}

    def encode(self) -> bytes:
        """The bytes of sweep.json."""
        values = json.loads(self.model_dump_json())
        return json.dumps(values | {DIGEST: _digest(values)}, indent=2).encode()


def is_sweep(directory: Path) -> bool:
    """Whether a folder is that of a sweep."""
    return (directory / FILE).is_file()


def read(directory: Path) -> SweepFile:
    """The sweep that a folder was made for.

    Raises:
        RunError: it is none, or its file is damaged.
    """
    path = directory / FILE
    try:
        found = SweepFile.model_validate_json(read_own(path, LARGEST))
    except OSError:
        raise RunError(f"{directory}: not a sweep (no {FILE} in it): name a folder that 'labctl sweep' made") from None
    except ValidationError as error:
        raise RunError(f"{path}: not such a file ({describe(error)}): begin a new sweep") from None
    if found.format_version not in WITHOUT_MICRO:
        return found
    return found.model_copy(update={"sweep": found.sweep.model_copy(update={"micro": ""})})


def read_to_go_on(directory: Path) -> SweepFile:
    """The sweep that a folder was made for, as it was asked for when that was done.

    Raises:
        RunError: it is none, or its file is damaged, or was edited.
    """
    found = read(directory)
    values = json.loads(read_own(directory / FILE, LARGEST))
    digest = values.pop(DIGEST, None)
    if digest is not None and digest != _digest(values):
        raise RunError(
            f"{directory / FILE}: edited since the sweep was begun: restore it from a copy, or begin a new sweep"
        )
    return found


def places(sweep: Sweep) -> list[tuple[str, dict[str, str]]]:
    """Name of the folder and values on the axes of every run, in the order they are measured.

    Raises:
        UsageError: the axes do not fit each other.
    """
    grid = points_of(sweep.over, zipped=sweep.zip)
    order = measuring_order(len(grid), sweep.order, sweep.seed)
    if sweep.reference_every:
        order = with_reference(order, sweep.reference_every)
    slugs = [_slug(values, sweep.micro) for values in grid]
    return [(f"{number:03d}-{slugs[place]}"[:LONGEST_NAME], grid[place]) for number, place in enumerate(order)]


def _digest(values: Mapping[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()


def _slug(values: Mapping[str, str], micro: str) -> str:
    written = re.sub(MICRO, micro, "-".join(f"{name}={value}" for name, value in values.items()))
    return re.sub(r"[^A-Za-z0-9.=+,_-]", "", written)
