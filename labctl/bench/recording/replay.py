"""How recordings are played: recorded benches served on loopback, and stations led to them.

The addresses travel in the environment, because some commands open their benches in processes of their own.
"""

import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from labctl.bench.recording.format import Kind, Recording
from labctl.bench.recording.recorder import bench_of
from labctl.bench.simulation import with_laser_commands
from labctl.bench.station import Station
from labctl.errors import StationError
from sim_backends.replay.server import Conversation, Step
from sim_backends.replay.server import Replay as Replay

VARIABLE = "LABCTL_REPLAY"


def replay_of(recordings: Sequence[Recording], port_base: int | None = None) -> Replay:
    """The benches of recordings, not started; instruments in the usual order of their ports.

    Recordings of benches with equal stations are played one behind the other, as one bench.

    Raises:
        RecordingError: a recording contradicts itself.
    """
    names = _names(recordings)
    benches: dict[str, dict[str, list[Conversation]]] = {}
    for recording in recordings:
        bench = benches.setdefault(names[recording.bench], {instrument: [] for instrument in Station().addresses})
        last = recording.records[-1].connection if recording.records else 0
        for connection in recording.connections:
            steps = tuple(Step(message.kind is Kind.SENT, message.read) for message in connection.messages)
            cut = not recording.complete and not connection.closed and connection.number == last
            bench.setdefault(connection.instrument, []).append(Conversation(steps, cut))
    return Replay(benches, port_base=port_base)


@contextmanager
def leading_to(replay: Replay, recordings: Sequence[Recording]) -> Iterator[None]:
    """Inside the block every station that this process or a child of it opens has addresses of `replay`.

    Which of them, the station itself decides, so that it does not matter who comes first. Where one bench is played, it
    is everybody's.
    """
    os.environ[VARIABLE] = json.dumps({bench: replay.resources[name] for bench, name in _names(recordings).items()})
    try:
        yield
    finally:
        del os.environ[VARIABLE]


def _names(recordings: Sequence[Recording]) -> dict[str, str]:
    """What each bench is called in reports: the first file that it is in."""
    return {recording.bench: recording.path.name for recording in reversed(recordings)}


def replayed() -> bool:
    """Whether every bench that this process opens is a recorded one."""
    return VARIABLE in os.environ


def redirected(station: Station) -> Station:
    """`station` with the addresses of the replay, if one is being played; a simulated laser keeps its command table.

    Raises:
        StationError: several benches were recorded, none of them with a station like this one.
    """
    text = os.environ.get(VARIABLE)
    if text is None:
        return station
    benches = json.loads(text)
    addresses = next(iter(benches.values())) if len(benches) == 1 else benches.get(bench_of(station))
    if addresses is None:
        raise StationError(f"{station.source}: no bench with these settings was recorded: repeat the recorded command")
    station = with_laser_commands(station)  # before the new addresses hide that the laser is the simulated one
    sections = {role: getattr(station, role).model_copy(update={"address": addresses[role]}) for role in addresses}
    return station.model_copy(update=sections)
