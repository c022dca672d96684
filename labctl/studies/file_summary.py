"""What a file is, known by what is in it, and what it says of itself in a few words."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from instruments.remedies import unreadable
from instruments.toml_files import TomlError, read_toml
from labctl.bench.recording.format import FORMAT as RECORDING
from labctl.bench.recording.format import Kind, read_recording
from labctl.errors import UsageError
from labctl.runs.format.plain_hdf5 import HDF5_ERRORS, attribute, walked
from labctl.runs.format.readout import FORMAT as READOUT
from protocols.registry import read_protocol

HDF5 = b"\x89HDF\r\n\x1a\n"
HEAD_BYTES = 200


def is_run(path: Path) -> bool:
    """Whether a path is that of a run: a directory, or a file of the name or the kind of data.h5."""
    return path.is_dir() or path.name == "data.h5" or _hdf5_says(path) == "run"


def summary_of(path: Path) -> dict[str, Any]:
    """What a file that is no run says of itself, as a JSON object; its first key says what it is.

    Raises:
        UsageError: it is nothing that labctl knows, or cannot be read.
        AnalysisError, StationError, ProtocolError: it is damaged.
    """
    for kind, summary in KINDS.items():
        if _kind(path) == kind:
            return summary(path)
    known = "a run directory, a data.h5, a readout, a recording, a station file or a protocol file"
    raise UsageError(f"{path}: is nothing that can be shown: name {known}")


def _kind(path: Path) -> str:
    if not path.is_file():
        raise UsageError(f"{path}: is no file: name another one")
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_BYTES)
    except OSError as error:
        raise UsageError(unreadable(path, error, "name another file")) from None
    if head.startswith(HDF5):
        return _hdf5_says(path)
    if head.startswith(b"{") and RECORDING.encode() in head:
        return "recording"
    if path.suffix != ".toml":
        return ""
    try:
        return "protocol" if "protocol" in read_toml(path) else "station"
    except (OSError, TomlError):
        return "station"  # whose reader says what is wrong


def _hdf5_says(path: Path) -> str:
    try:
        with walked(path) as file:
            if "_NCProperties" in file.attrs:
                return "netcdf"
            if "format" in file.attrs and attribute(file, "format") == READOUT:
                return "readout"
            return "run" if "manifest" in file.attrs else ""
    except HDF5_ERRORS:
        return "readout"  # whose reader says what is wrong


def _readout(path: Path) -> dict[str, Any]:
    from labctl.studies.readout_file import load_metadata  # with scikit-learn, which no other file needs

    return {"model": str(path)} | load_metadata(path)


def _recording(path: Path) -> dict[str, Any]:
    recording = read_recording(path)
    last = recording.records[-1].time_s if recording.records else 0.0
    return {
        "recording": str(path),
        "started": recording.heading.get("started"),
        "bench": recording.bench,
        "complete": recording.complete,
        "lost_bytes": recording.lost_bytes,
        "seconds": last,
        "connections": {
            f"{one.number}: {one.instrument} at {one.resource}": {
                "sent": sum(message.kind is Kind.SENT for message in one.messages),
                "received": sum(message.kind is Kind.RECEIVED for message in one.messages),
                "bytes": sum(message.length for message in one.messages),
            }
            for one in recording.connections
        },
    }


def _station(path: Path) -> dict[str, Any]:
    from labctl.bench.station import read_station  # with every driver, which no other file needs

    return {"station": str(path)} | read_station(path).model_dump(mode="json", exclude={"source"})


def _protocol(path: Path) -> dict[str, Any]:
    protocol = read_protocol(str(path), ())
    return {
        "protocol": protocol.name,
        "file": str(path),
        "digest": protocol.digest(),
        "settings": protocol.model_dump(mode="json"),
    }


def _netcdf(path: Path) -> dict[str, Any]:
    raise UsageError(f"{path}: is a netCDF file: open it with xarray.open_dataset, or show the run it was made from")


KINDS: dict[str, Callable[[Path], dict[str, Any]]] = {
    "readout": _readout,
    "recording": _recording,
    "station": _station,
    "protocol": _protocol,
    "netcdf": _netcdf,
}
