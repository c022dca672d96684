"""What the columns of a run are called, hold and mean: the one place where a column is declared.

`SHOTS` are the columns of the table `/shots`, `ARRAYS` the other data sets. plan.h5, shards, data.h5, readers,
exports and docs/reference/run-format.md are made from them.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import IntFlag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from labctl.runs.format.shape import RunShape

LONGEST_KIND = 16
FIRST_VERSION = "1.0"
VOLTS = "volts = scale * code + offset"


@dataclass(frozen=True)
class Column:
    """A column of `/shots`, or a data set of data.h5.

    Attributes:
        name: what it is called.
        type: of its values, as NumPy writes it; that of `/frames` is the run's `code_type`.
        meaning: what its values say, in a few words.
        unit: of its values, empty for none.
        axes: what each of its dimensions counts: shot, port, sample, pass or drive_sample.
        planned: whether the plan fixes it; otherwise it is known when the shot has been measured.
        journalled: whether the journal says it, and not the shard: it may become known later.
        since: the first version of the format that has it.
        absent: its value where a file of an earlier version, or a plan, does not give it.
    """

    name: str
    type: str
    meaning: str
    unit: str = ""
    axes: tuple[str, ...] = ("shot",)
    planned: bool = True
    journalled: bool = False
    since: str = FIRST_VERSION
    absent: float = -1


SHOTS = (
    Column("index", "<i8", "place of the shot in the plan"),
    Column("kind", f"S{LONGEST_KIND}", "what the shot is for: image, reference, dark or another word of the protocol"),
    Column("dataset_index", "<i8", "index in the data set, -1 for none"),
    Column("label", "<i8", "class, -1 for none"),
    Column("wavelength_nm", "<f8", "laser wavelength of the shot, the first one where it is measured at several", "nm"),
    Column("group", "<i8", "shots of one image share a group: keep groups together when data are split"),
    Column("epoch", "<i4", "stretch of an unchanged optical path, on the pass that completed the shot", planned=False),
    Column(
        "time_s", "<f8", "when the shot was completed, after the run began, on the bench's clock", "s", planned=False
    ),
    Column("flags", "<i4", "bit 0: a frame of the shot is clipped", planned=False),
    Column(
        "next_dataset_index",
        "<i8",
        "index in the data set of what a scene's image changes to, -1 for other shots",
        since="1.1",
    ),
    Column("next_label", "<i8", "class of what a scene's image changes to, -1 for other shots", since="1.1"),
    Column(
        "suspect",
        "|i1",
        "1 where a setting was, or may have been, changed from elsewhere while the shot was measured",
        planned=False,
        journalled=True,
        since="1.3",
        absent=0,
    ),
)
"""The columns of `/shots`."""
ARRAYS = (
    Column("frames", "", f"digitiser codes: {VOLTS}", axes=("shot", "port", "sample"), planned=False),
    Column("trigger_offset_s", "<f8", "time from the trigger to the sample grid", "s", ("shot", "port"), planned=False),
    Column(
        "clipped",
        "?",
        "whether the frame touches the end of the digitiser's range",
        "",
        ("shot", "port"),
        planned=False,
    ),
    Column("epoch", "<i4", "stretch of an unchanged optical path, on each pass", "", ("shot", "pass"), planned=False),
    Column(
        "measured_at_s",
        "<f8",
        "when the shot was measured on each pass, after the run began, on the bench's clock",
        "s",
        ("shot", "pass"),
        planned=False,
    ),
    Column("shot", "<i8", "place of the shot in the plan"),
    Column("ports", "<i8", "waveguide of the chip; 0 is the fibre before it", axes=("port",)),
    Column("pass_of_port", "<i8", "pass that measured the port", axes=("port",)),
    Column(
        "wavelength_of_port",
        "<f8",
        "laser wavelength at which the port was measured, 0 where the run does not say",
        "nm",
        ("port",),
    ),
    Column("scale", "<f8", VOLTS, "V", ("port",), planned=False),
    Column("offset", "<f8", VOLTS, "V", ("port",), planned=False),
    Column("time", "<f8", "time after the trigger; of sequences, after their frame's first sample", "s", ("sample",)),
    Column("passes", "<i8", "number of the pass", axes=("pass",)),
    Column("drive/samples", "<f4", "one period of what the AWG played, full scale -1 to 1", axes=("drive_sample",)),
    Column("drive/marker", "?", "marker of the AWG at each sample of the drive", axes=("drive_sample",)),
)
"""The data sets of data.h5 other than `/shots`."""
PLANNED = tuple(column for column in SHOTS if column.planned)
MEASURED = tuple(column for column in SHOTS if not (column.planned or column.journalled))
OF_A_SHOT = tuple(column for column in ARRAYS if column.axes[0] == "shot" and not column.planned)
"""The arrays that are measured with each shot."""


def dtype_of(columns: Iterable[Column]) -> np.dtype[Any]:
    """The type of one row of a table with some columns."""
    return np.dtype([(column.name, column.type) for column in columns])


SHOTS_DTYPE = dtype_of(SHOTS)
ROWS_DTYPE = np.dtype([("shot", "<i8"), *dtype_of(MEASURED).descr])
"""What a shard holds of each shot in addition to its frames."""


class ShotFlag(IntFlag):
    """Bits of the column `flags` of `/shots`."""

    CLIPPED = 1  # at least one frame touches the end of the digitiser's range


def shot_table(**columns: ArrayLike) -> NDArray[Any]:
    """The planned `/shots`, shape (shots,), of arrays in the order of measurement; the measured columns are still zero.

    `index` follows from the order. A column that came after the first version of the format may be left out.

    Raises:
        ValueError: no such column, one that is missing, columns of different lengths, or a kind that is no short text.
    """
    kinds = _kinds(columns.get("kind", ()))
    table = np.zeros(kinds.shape, SHOTS_DTYPE)
    columns |= {"kind": kinds, "index": np.arange(table.size)}
    if unknown := columns.keys() - {column.name for column in PLANNED}:
        raise ValueError(f"no column of the plan is called {min(unknown)}")
    for column in PLANNED:
        if column.name not in columns and column.since == FIRST_VERSION:
            raise ValueError(f"without {column.name}")
        values = np.asarray(columns.get(column.name, np.full(table.shape, column.absent)))
        if values.shape != table.shape:
            raise ValueError(f"column {column.name} has shape {values.shape}, kind has {table.shape}")
        table[column.name] = values
    return table


def in_this_version(table: NDArray[Any], dtype: np.dtype[Any] = SHOTS_DTYPE) -> NDArray[Any]:
    """A table of any 1.x with the columns of this version; those that came later are what they are when absent.

    Raises:
        ValueError, TypeError: it is no such table.
    """
    there = table.dtype.names or ()
    later = {column.name: column.absent for column in SHOTS if column.since != FIRST_VERSION}
    found = np.zeros(table.shape, dtype)
    for name in dtype.names or ():
        if name not in there and name not in later:
            raise ValueError(f"without {name}")
        found[name] = table[name] if name in there else later[name]
    return found


def require_table(stored: NDArray[Any], shots: int) -> None:
    """Compare the table `/shots` of a file of any 1.x with what its columns are declared to be.

    Raises:
        ValueError: it has another number of rows, or a column of another kind or with values that are not finite.
    """
    if stored.shape != (shots,) or stored.dtype.names is None:
        raise ValueError(f"/shots has no {shots} rows")
    for column in SHOTS:
        if column.name in stored.dtype.names:
            _require_like(f"/shots.{column.name}", stored[column.name], column.type)


def require_array(name: str, values: NDArray[Any], sizes: Mapping[str, int]) -> None:
    """Compare an array of data.h5 with what it is declared to be; one that is not declared is nobody's concern.

    Raises:
        ValueError: it is of another shape or kind, or has values that are not finite.
    """
    for array in ARRAYS:
        if array.name == name:
            if values.shape != tuple(sizes[axis] for axis in array.axes):
                raise ValueError(f"/{name} has the shape {values.shape}")
            _require_like(f"/{name}", values, array.type)


def _require_like(name: str, values: NDArray[Any], declared: str) -> None:
    kind = np.dtype(declared).kind
    if values.dtype.kind != kind:
        raise ValueError(f"{name} is of type {values.dtype}")
    if kind == "f" and not np.isfinite(values).all():
        raise ValueError(f"{name} has values that are not finite")


def same_shots(stored: NDArray[Any], planned: NDArray[Any]) -> bool:
    """Whether two planned tables of shots agree in every column that the stored one, of any 1.x, has."""
    there = {column.name for column in PLANNED} & set(stored.dtype.names or ())
    return all(stored[name].astype(planned.dtype[name]).tobytes() == planned[name].tobytes() for name in there)


def sizes_of(shape: RunShape, shots: int) -> dict[str, int]:
    """How long each axis is where `shots` of a run are there."""
    return {"shot": shots, "port": len(shape.ports), "sample": shape.samples, "pass": len(shape.passes)}


def _kinds(kinds: ArrayLike) -> NDArray[Any]:
    """Kinds as they are stored.

    Raises:
        ValueError: one is no ASCII text, or too long.
    """
    found = np.asarray(kinds)
    try:
        stored = found.astype("S")
    except UnicodeEncodeError:
        stored = None
    if stored is None or stored.dtype.itemsize > LONGEST_KIND:
        raise ValueError(f"kind of a shot is an ASCII text of at most {LONGEST_KIND} characters, not {found!r}")
    return stored
