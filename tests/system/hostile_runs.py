"""Hostile runs and readouts: what is damaged in a whole one, and what the refusal says."""

import json
import os
import struct
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import h5py
import numpy as np

from instruments.values import Frames
from labctl.analysis.readouts import softmax_classifier
from labctl.runs.format.global_heaps import HEAP
from labctl.runs.format.journal import read_journal
from labctl.runs.format.plain_hdf5 import set_text
from labctl.runs.format.shard import encode
from labctl.studies.readout_file import save_model
from tests.fuzz.files import OLDER
from tests.fuzz.readers import SHAPE
from tests.labctl.runs.conftest import write_whole

Made = bytes | Callable[[Path], object]
"""What is in a hostile file, or what makes one at a path."""
RUNS: dict[str, dict[str, tuple[Made, str]]] = {}
"""Kind of file -> hostile file -> what is in it, and what the refusal says."""

IN_CIRCLES = "do not lie one behind the other"
NAMES_ANOTHER_PLACE = "another place"
NAMES_OTHER_FILES = "keeps its data in other files"
Change = Callable[[h5py.File, str], object]


def linked(file: h5py.File, name: str) -> None:
    del file[name]
    file[name] = h5py.ExternalLink("../secret.h5", "/a")


def soft(file: h5py.File, name: str) -> None:
    del file[name]
    file["elsewhere"] = h5py.ExternalLink("secret.h5", "/")
    file[name] = h5py.SoftLink("/elsewhere/a")


def virtual(file: h5py.File, name: str) -> None:
    layout = h5py.VirtualLayout(file[name].shape, file[name].dtype)
    layout[...] = h5py.VirtualSource("secret.h5", "a", file[name].shape)
    del file[name]
    file.create_virtual_dataset(name, layout)


def outside(file: h5py.File, name: str) -> None:
    shape, kind = file[name].shape, file[name].dtype
    del file[name]
    file.create_dataset(name, shape, kind, external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])


def huge(file: h5py.File, name: str) -> None:
    shape, kind = file[name].shape, file[name].dtype
    del file[name]
    file.create_dataset(name, (1 << 40, *shape[1:]), kind, chunks=(1, *shape[1:]))


def packed(file: h5py.File, name: str) -> None:
    shape, kind = file[name].shape, file[name].dtype
    del file[name]
    row = (*shape[1:], 1 << 14)
    wide = file.create_dataset(name, (1 << 16, *row), kind, chunks=(1, *row), compression="gzip")
    wide[0] = 0


def texts(file: h5py.File, name: str) -> None:
    del file[name]
    file.create_dataset(name, data=["x" * 1000] * 20, dtype=h5py.string_dtype())


def crowded(file: h5py.File, _name: str) -> None:
    for number in range(1100):
        file.create_group(f"group{number}")


def in_itself(file: h5py.File, _name: str) -> None:
    file["again"] = file["/"]


def circling(image: bytes) -> bytes:
    """A file whose texts, or whatever else lies in its heaps, HDF5 would read in circles for ever."""
    harmed = bytearray(image)
    found = image.find(HEAP)
    assert found >= 0
    while found >= 0:
        struct.pack_into("<Q", harmed, found + 16 + 8, 2**64 - 16)
        found = image.find(HEAP, found + 1)
    return bytes(harmed)


def circling_virtual(file: h5py.File, name: str) -> None:
    """HDF5 reads where the data of such a data set are as soon as it is opened."""
    virtual(file, name)
    path = Path(file.filename)
    file.close()
    path.write_bytes(circling(path.read_bytes()))


def manifest_of_variable_length(file: h5py.File, _name: str) -> None:
    text = file.attrs["manifest"].decode()
    del file.attrs["manifest"]
    file.attrs["manifest"] = text


def changed(make: Callable[[Path], Path], change: Change, name: str) -> Callable[[Path], object]:
    def made(path: Path) -> None:
        with h5py.File(make(path), "r+") as file:
            change(file, name)

    return made


def a_shard(path: Path) -> Path:
    ports, shots = len(SHAPE.passes[0]), 3
    columns = np.zeros((shots, ports))
    frames = Frames(np.zeros((*columns.shape, SHAPE.samples), np.int8), columns, np.zeros(shots), columns > 0)
    path.write_bytes(encode(SHAPE, 0, 0, [frames], 0, np.ones(ports), np.zeros(ports)))
    return path


@cache
def whole() -> bytes:
    """The data.h5 of a run."""
    with TemporaryDirectory() as folder:
        return (write_whole(Path(folder) / "run") / "data.h5").read_bytes()


def a_data_file(path: Path) -> Path:
    path.write_bytes(whole())
    return path


DAMAGES: dict[str, tuple[Change, str]] = {
    "a link to another file": (linked, NAMES_ANOTHER_PLACE),
    "a link to a link": (soft, NAMES_ANOTHER_PLACE),
    "a virtual data set": (virtual, NAMES_OTHER_FILES),
    "data in another file": (outside, NAMES_OTHER_FILES),
    "numbers nobody stored": (huge, "that are not in the file"),
    "numbers packed to nothing": (packed, "that are not in the file"),
    "texts in place of numbers": (texts, "holds texts of variable length"),
    "a virtual data set in circles": (circling_virtual, ""),
    "a thousand groups": (crowded, "more than 1000 objects"),
    "a group in itself": (in_itself, "more than 1000 objects"),
}
RUNS["shard"] = {
    f"{what}: {name}": (changed(a_shard, change, name), text)
    for what, (change, text) in DAMAGES.items()
    for name in ("frames", "rows", "scale")
    if name == "frames" or "group" not in what
}
RUNS["run"] = {
    f"{what}: {name}": (changed(a_data_file, change, name), text)
    for what, (change, text) in DAMAGES.items()
    for name in ("frames", "shots", "drive/samples")
    if name == "frames" or "group" not in what
}
RUNS["shard"]["an older one with a heap in circles"] = (
    circling((OLDER / "complete" / "shards" / "000000.h5").read_bytes()),
    IN_CIRCLES,
)
RUNS["run"] |= {
    "an older one with a heap in circles": (circling((OLDER / "complete" / "data.h5").read_bytes()), IN_CIRCLES),
    "a manifest of variable length": (
        changed(a_data_file, manifest_of_variable_length, ""),
        "'manifest' is a text of variable length",
    ),
}


def huge_plan(path: Path) -> None:
    manifest = write_whole(path) / "manifest.json"
    values = json.loads(manifest.read_text("utf-8"))
    values["shape"]["shots"] = 10**15
    manifest.write_text(json.dumps(values), "utf-8")


def huge_shots(path: Path) -> None:
    manifest = write_whole(path) / "manifest.json"
    values = json.loads(manifest.read_text("utf-8"))
    values["shape"]["samples"] = 10**15
    manifest.write_text(json.dumps(values), "utf-8")


def a_shard_of_any_number(path: Path) -> None:
    journal = write_whole(path) / "journal.jsonl"
    entries = read_journal(journal).entries
    journal.write_bytes(b"".join(replace(entry, shard=10**30).encode() for entry in entries))


def figures_elsewhere(path: Path) -> None:
    write_whole(path)
    (path / "figures").symlink_to(path.parent)


def report_elsewhere(path: Path) -> None:
    write_whole(path)
    (path / "report.html").symlink_to(path.parent / "profile")


RUNS["run"] |= {
    "a plan of 10^15 shots": (huge_plan, "damaged manifest"),
    "shots of 10^15 samples": (huge_shots, "damaged manifest"),
    "a shard with a number of thirty digits": (a_shard_of_any_number, "is not of this run"),
    "a folder of figures that is elsewhere": (figures_elsewhere, NAMES_ANOTHER_PLACE),
    "a report that is elsewhere": (report_elsewhere, NAMES_ANOTHER_PLACE),
}


def a_million_passes(path: Path, ports: Sequence[int] = (2,)) -> None:
    manifest = write_whole(path) / "manifest.json"
    values = json.loads(manifest.read_text("utf-8"))
    values["shape"]["passes"] = [ports] * 10**6
    manifest.write_text(json.dumps(values), "utf-8")


def a_shard_without_end(path: Path) -> None:
    (write_whole(path) / "data.h5").unlink()
    os.truncate(path / "shards" / "000000.h5", 1 << 40)


RUNS["run"] |= {
    "a manifest in a manifest": (
        lambda path: (write_whole(path) / "manifest.json").write_bytes(b"[" * 100_000),
        "damaged manifest",
    ),
    "a manifest without end": (
        lambda path: os.truncate(write_whole(path) / "manifest.json", 1 << 40),
        "manifest.json: cannot be read (has 1099511627776 bytes",
    ),
    "a million passes": (a_million_passes, "1000000 ports in 1000000 passes: a run has at most"),
    "a million passes of no port": (
        lambda path: a_million_passes(path, []),
        "in 1000000 passes: a run needs at least one shot",
    ),
    "a journal without end": (
        lambda path: os.truncate(write_whole(path) / "journal.jsonl", 1 << 40),
        "journal.jsonl: cannot be read (has 1099511627776 bytes",
    ),
    "a journal of nothing but ends of lines": (
        lambda path: (write_whole(path) / "journal.jsonl").write_bytes(b"\n" * (1 << 20)),
        "1000 of its lines are damaged",
    ),
    "a plan without end": (
        lambda path: os.truncate(write_whole(path) / "plan.h5", 1 << 40),
        "has 1099511627776 bytes",
    ),
    "a shard without end": (a_shard_without_end, "000000.h5: cannot be read (has 1099511627776 bytes"),
}


def a_readout(path: Path) -> Path:
    pipeline = softmax_classifier().fit(np.eye(4), np.arange(4) % 2)
    save_model(path, pipeline, {"seed": 1})
    return path


def attribute(name: str, value: str) -> Change:
    def change(file: h5py.File, group: str) -> None:
        set_text(file[group], name, value)

    return change


def text_of_variable_length(name: str) -> Change:
    def change(file: h5py.File, group: str) -> None:
        file[group].attrs[name] = "some text"

    return change


DAMAGED_READOUTS: dict[str, tuple[Made, str]] = {
    what: (changed(a_readout, change, "softmaxregression/coef_"), text) for what, (change, text) in DAMAGES.items()
}
RUNS["readout"] = DAMAGED_READOUTS | {
    "an older one with a heap in circles": (circling((OLDER / "readout.h5").read_bytes()), IN_CIRCLES),
    "a class of the system": (
        changed(a_readout, attribute("estimator", "os.system"), "softmaxregression"),
        "unknown class",
    ),
    "steps in steps": (changed(a_readout, attribute("steps", "[" * 60_000), "/"), "a damaged readout"),
    "settings of another class": (
        changed(a_readout, attribute("parameters", '{"system": 1}'), "softmaxregression"),
        "a damaged readout",
    ),
    "a text of variable length": (
        changed(a_readout, text_of_variable_length("estimator"), "softmaxregression"),
        "'estimator' is a text of variable length",
    ),
    "no metadata": (changed(a_readout, attribute("metadata", "[]"), "/"), "a damaged readout"),
    "no steps": (changed(a_readout, attribute("steps", "[]"), "/"), "a damaged readout"),
}
