"""What may be wrong with a file: every array, attribute and entry changed in every way that somebody came up with."""

import json
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import h5py
import numpy as np

Damage = Callable[[h5py.File], None]

ENTRIES: Mapping[str, object] = {
    "nothing": None,
    "a fraction": 66.5,
    "a whole number as a fraction": 66.0,
    "negative": -1,
    "zero": 0,
    "huge": 1 << 60,
    "larger than any": 10**40,
    "not a number": float("nan"),
    "infinite": float("inf"),
    "true": True,
    "text": "66",
    "no text": "",
    "a list": [],
    "a map": {},
    "lists in lists": [[["a"]]],
}
"""What may stand in place of an entry of a JSON file."""


def of_json(values: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """The text of a JSON file with one entry changed, and what was changed, for every entry at every depth."""
    for path in _places(values):
        name = ".".join(map(str, path))
        yield f"{name} missing", json.dumps(_with(values, path))
        for kind, entry in ENTRIES.items():
            yield f"{name} {kind}", json.dumps(_with(values, path, entry))


def _places(values: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    entries = values.items() if isinstance(values, dict) else enumerate(values) if isinstance(values, list) else ()
    for name, entry in list(entries)[:20]:
        yield (*above, name)
        yield from _places(entry, (*above, name))


def _with(values: Any, path: tuple[Any, ...], *entry: object) -> Any:
    """A copy with another entry at `path`, or without it."""
    copy = json.loads(json.dumps(values))
    inner = copy
    for name in path[:-1]:
        inner = inner[name]
    if entry:
        inner[path[-1]] = entry[0]
    else:
        del inner[path[-1]]
    return copy


def of_hdf5(file: h5py.File) -> Iterator[tuple[str, Damage]]:
    """What can be done to each array and attribute in a file, and a name for it."""
    items: dict[str, Any] = {"/": file["/"]}
    file.visititems(items.__setitem__)
    for name, item in items.items():
        if isinstance(item, h5py.Dataset):
            yield f"{name} missing", partial(_remove, name=name)
            yield f"{name} a group", partial(_replace_by_group, name=name)
            for kind, change in _ARRAYS.items():
                yield f"{name} {kind}", partial(_replace, name=name, change=change)
        else:
            for attribute in item.attrs:
                yield f"{name}@{attribute} missing", partial(_remove_attribute, group=name, name=attribute)
                for kind, value in _ATTRIBUTES.items():
                    yield f"{name}@{attribute} {kind}", partial(_set, group=name, name=attribute, value=value)


def _first(values: Any, value: object) -> Any:
    """A copy with another first entry."""
    changed = np.array(values, np.float64 if isinstance(value, float) and values.dtype.kind != "V" else values.dtype)
    changed.flat[0] = value
    return changed


_ARRAYS: Mapping[str, Callable[[Any], Any]] = {
    "empty": lambda values: values.ravel()[:0],
    "of one entry": lambda values: values.ravel()[:1],
    "flat": lambda values: values.ravel(),
    "with one axis more": lambda values: values[np.newaxis],
    "turned": lambda values: values.T[..., np.newaxis] if values.ndim < 2 else values.T,
    "one shorter": lambda values: values[:-1],
    "one longer": lambda values: np.concatenate([values, values[-1:]]),
    "backwards": lambda values: values[::-1],
    "a single number": lambda _: np.float64(1.5),
    "nothing but null": lambda _: h5py.Empty("f8"),
    "text": lambda values: np.full(values.shape, b"x"),
    "true": lambda values: np.ones(values.shape, np.bool_),
    "complex": lambda values: np.ones(values.shape, np.complex128),
    "half precision": lambda values: np.ones(values.shape, np.float16),
    "bytes of any kind": lambda values: np.zeros(values.shape, "V3"),
    "a table": lambda values: np.zeros(values.shape, [("a", "<i4"), ("b", "<f8")]),
    "big-endian": lambda values: np.zeros(values.shape, ">f8"),
    "zeros": np.zeros_like,
    "negative": lambda values: np.full(values.shape, -7),
    "huge": lambda values: np.full(values.shape, 1 << 60),
    "beyond 64 bits": lambda values: np.full(values.shape, 2.0**80),
    "one not a number": lambda values: _first(values, np.nan),
    "one infinite": lambda values: _first(values, np.inf),
    "not numbers": lambda values: np.full(values.shape, np.nan),
}
_ATTRIBUTES: Mapping[str, object] = {
    "empty": b"",
    "text": b"x",
    "not in UTF-8": b"\xff\xfe",
    "a number": 3,
    "a fraction": 2.5,
    "not a number": float("nan"),
    "an array": np.arange(3),
    "null": b"null",
    "a list": b"[1, [], {}]",
    "a map": b'{"a": 1}',
    "JSON without end": b"[" * 5000,
    "a large number": b"1e999",
    "HDF5's own nothing": h5py.Empty("S1"),
}


def _replace(file: h5py.File, name: str, change: Callable[[Any], Any]) -> None:
    values = file[name][()]
    try:
        changed = change(values)
    except (ValueError, TypeError, IndexError):
        changed = np.zeros(0)  # what has no such form
    del file[name]
    file[name] = changed


def _replace_by_group(file: h5py.File, name: str) -> None:
    del file[name]
    file.create_group(name)


def _remove(file: h5py.File, name: str) -> None:
    del file[name]


def _remove_attribute(file: h5py.File, group: str, name: str) -> None:
    del file[group].attrs[name]


def _set(file: h5py.File, group: str, name: str, value: object) -> None:
    del file[group].attrs[name]
    file[group].attrs[name] = np.bytes_(value) if isinstance(value, bytes) else value
