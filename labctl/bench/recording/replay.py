"""How recordings are played: recorded benches served on loopback, and stations redirected to them."""

from collections.abc import Mapping, Sequence

from labctl.bench.recording.format import Kind, Recording
from labctl.bench.recording.recorder import bench_of
from labctl.bench.simulation import with_laser_commands
from labctl.bench.station import Station
from labctl.errors import StationError
from sim_backends.replay.server import Conversation, Step
from sim_backends.replay.server import Replay as Replay


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


def addresses(replay: Replay, recordings: Sequence[Recording]) -> dict[str, Mapping[str, str]]:
    """Where `replay`, which is started, plays the instruments of each bench of `recordings`."""
    return {bench: replay.resources[name] for bench, name in _names(recordings).items()}


def _names(recordings: Sequence[Recording]) -> dict[str, str]:
    """What each bench is called in reports: the first file that it is in."""
    return {recording.bench: recording.path.name for recording in reversed(recordings)}


def redirected(station: Station, benches: Mapping[str, Mapping[str, str]]) -> Station:
    """`station` with the addresses of the one of `benches` that is like it; a simulated laser keeps its command table.

    The station decides which, so that it does not matter who comes first; one bench alone is everybody's.

    Raises:
        StationError: several benches were recorded, none of them with a station like this one; or it has an instrument
            that was not recorded, and would be spoken to itself.
    """
    resources = next(iter(benches.values())) if len(benches) == 1 else benches.get(bench_of(station))
    if resources is None:
        raise StationError(f"{station.source}: no bench with these settings was recorded: repeat the recorded command")
    own = set(station.roles).difference(resources, station.simulations, station.by_hand)
    if own:
        names = ", ".join(sorted(own))
        raise StationError(
            f"{station.source}: {names} is not in the recording, so a replay would speak to the real one: repeat the "
            f"recorded command with its own station file, or leave the section out"
        )
    station = with_laser_commands(station)  # before the new addresses hide that the laser is the simulated one
    sections = {
        role: station.section_of(role).model_copy(update={"address": resources[role]})
        for role in station.roles
        if role in resources
    }
    return station.model_copy(update=sections)
