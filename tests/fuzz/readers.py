"""Everything that reads a file somebody else may have made, and the one error it may end in."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from instruments.errors import NotConfigured
from instruments.laser_table import LaserTable
from labctl.bench import calibration
from labctl.bench.recording.format import read_recording
from labctl.bench.station import Station, read_station
from labctl.dashboard import wording
from labctl.dashboard.state import RunState, advanced
from labctl.datasets import pictures, store
from labctl.datasets.cards import DataFile
from labctl.datasets.idx import parse_idx
from labctl.datasets.images import read_npz
from labctl.datasets.series import parse_series
from labctl.datasets.vowels import parse_vowels
from labctl.errors import AnalysisError, DatasetError, ExperimentError, RecordingError, RunError, StationError
from labctl.runs.format.journal import read_journal
from labctl.runs.format.shape import RunShape
from labctl.runs.format.shard import Shard
from labctl.runs.live.events import EventReader
from labctl.runs.read.run import open_run
from labctl.studies.paper.experiments import experiments
from labctl.studies.readout_file import load_metadata, load_model
from protocols.base import ProtocolError
from protocols.registry import read_protocol
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.awg70002a.seqx import read_seqx
from sim_backends.virtual.awg70002a.wfmx import read_text, read_wfmx

SHAPE = RunShape(shots=7, passes=((2, 3, 4, 5), (6,)), samples=16, sample_interval_s=20e-12, start_s=-40e-12)
"""Of the runs that shards and run directories here belong to."""
PICTURE = (6, 8)
CLASSES = ("Negative", "Positive")


@dataclass(frozen=True)
class Reader:
    """`read` takes a path and reads all that is there; `refuses` is the error for what cannot be taken."""

    read: Callable[[Path], object]
    refuses: type[Exception] | tuple[type[Exception], ...]


def _experiment(path: Path) -> None:
    for experiment in experiments((path.stem,), folder=path.parent):
        _ = experiment.protocols


def _calibration(path: Path) -> None:
    if (found := calibration.read(path)) is not None:
        calibration.concerns(found, Station(), datetime(2026, 11, 21, tzinfo=UTC))


def _events(path: Path) -> None:
    state = RunState()
    for event in EventReader(path).read():
        state = advanced(state, event)
    for drawn in (wording.emission, wording.image, wording.log):
        drawn(state)
    wording.progress(state, (0, 0))
    wording.instruments(state, {})


def _recording(path: Path) -> None:
    recording = read_recording(path)
    for connection in recording.connections:
        for message in connection.messages:
            message.read()


def _run(path: Path) -> None:
    with open_run(path) as run:
        _ = (
            run.drive,
            run.shots,
            run.epoch,
            run.clipped,
            run.trigger_offset_s,
            run.measured_at_s,
            run.volts(),
            run.digest(),
        )


def _pictures(path: Path) -> None:
    with pictures.opened(path.parent, CLASSES) as album:
        for name in album.names:
            pictures.decode(album.content(name), name, PICTURE)


def _packed(path: Path) -> None:
    store.read(path.parent, DataFile(name=path.name, role="images", sha256="0" * 64))


READERS: Mapping[str, Reader] = {
    "calibration": Reader(_calibration, ()),
    "events": Reader(_events, ()),
    "station": Reader(read_station, StationError),
    "protocol": Reader(lambda path: read_protocol(str(path), []), ProtocolError),
    "experiment": Reader(_experiment, (ExperimentError, ProtocolError)),
    "laser table": Reader(LaserTable.read, NotConfigured),
    "recording": Reader(_recording, RecordingError),
    "run": Reader(_run, RunError),
    "shard": Reader(lambda path: Shard.decode(path.read_bytes(), SHAPE, path.name), RunError),
    "journal": Reader(read_journal, RunError),
    "readout": Reader(lambda path: (load_model(path), load_metadata(path)), AnalysisError),
    "idx": Reader(lambda path: parse_idx(path.read_bytes(), path.name), DatasetError),
    "packed idx": Reader(_packed, DatasetError),
    "npz": Reader(read_npz, DatasetError),
    "series": Reader(lambda path: parse_series(path.read_bytes(), path.name), DatasetError),
    "vowels": Reader(lambda path: parse_vowels(path.read_bytes(), path.name), DatasetError),
    "pictures": Reader(_pictures, DatasetError),
    "wfmx": Reader(lambda path: read_wfmx(memoryview(path.read_bytes())), ScpiError),
    "waveform text": Reader(lambda path: read_text(memoryview(path.read_bytes())), ScpiError),
    "seqx": Reader(lambda path: read_seqx(memoryview(path.read_bytes())), ScpiError),
}
