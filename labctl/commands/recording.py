"""`labctl record`: keep what goes over the wire. `labctl replay`: instruments that answer as recorded, nothing else."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

import typer

from instruments.errors import InstrumentError
from labctl.bench.recording.format import Recording, read_recording
from labctl.bench.recording.recorder import recording_before, recordings
from labctl.bench.recording.replay import Replay, addresses, replay_of
from labctl.bench.recording.wire import Played, RecordingRequest, Wire
from labctl.bench.signals import stops_heard
from labctl.bench.station import write_addresses
from labctl.commands.exit_status import DONE, FELL_SHORT, INTERRUPTED
from labctl.commands.options import PortBaseOption, SaveStationOption
from labctl.commands.output import JsonOption, say, show, table, tell
from labctl.commands.service import serving
from labctl.errors import RecordingError, UsageError

POLL_S = 0.5
INSIDE = "name the command inside it"
APART: Mapping[tuple[str, ...], str] = {
    ("record",): INSIDE,
    ("replay",): INSIDE,
    ("queue", "start"): "its items are commands of their own: name one of these",
    ("init",): "it asks at every address who is there: name labctl check",
}
"""Commands that would speak past the recording to the instruments themselves, and what to do instead."""

File = Annotated[Path, typer.Argument(help="Recording.")]


def record(
    context: typer.Context,
    file: File,
    command: Annotated[list[str], typer.Argument(help="-- and the command of labctl to record.")],
    mask: Annotated[
        bool, typer.Option("--mask", help="Replace serial numbers in *IDN? replies, hosts in addresses, the command.")
    ] = False,
    as_json: JsonOption = False,
) -> int:
    """Carry out a command of labctl and keep every byte to and from every instrument, with its time.

    A command that opens several benches writes one file for each: FILE, then the same name with -2, -3 ...
    """
    _refuse_apart(command)
    if existing := recordings(file):
        raise RecordingError(f"{existing[0]}: exists: name a new file, or remove the old recording")
    if (first := recording_before(file)) is not None:
        raise RecordingError(f"{file}: would be played as a further bench of {first}: name another file")
    try:
        request = RecordingRequest(path=file.absolute(), mask=mask, command=tuple(command))
        return _carry_out(context, command, Wire(record=request), as_json)
    finally:
        written = recordings(file)
        tell(
            f"recorded in {', '.join(map(str, written))}"
            if written
            else "no message went to an instrument: nothing was recorded"
        )


def replay(
    context: typer.Context,
    file: File,
    command: Annotated[list[str] | None, typer.Argument(help="-- and a command of labctl to run against it.")] = None,
    port_base: PortBaseOption = None,
    save_station: SaveStationOption = None,
    as_json: JsonOption = False,
) -> int:
    """Serve a recording as instruments on loopback, until it is played or the first message differs from it.

    To a command every bench of the recording is played: FILE, and those next to it with -2, -3 ... Exit 0 when the
    whole recording was played, 1 at a difference, which one line on standard error describes.
    """
    if command:
        _refuse_apart(command)
        if port_base is not None or save_station is not None:
            raise UsageError("--port-base and --save-station are for clients of your own: leave the command out")
        played = [_read(path) for path in recordings(file) or [file]]
        with serving(replay_of(played), "--port-base") as served:
            return _play_to(context, command, served, played, as_json)
    with serving(replay_of([_read(file)], port_base), f"--port-base {port_base}") as served:
        (resources,) = served.resources.values()
        if save_station is not None:
            write_addresses(save_station, resources)
        return _serve(served, resources, as_json)


def _read(file: Path) -> Recording:
    recording = read_recording(file)
    if not recording.complete:
        tell(
            f"{file}: is incomplete, its writer was stopped ({recording.lost_bytes} bytes of a torn record are left "
            f"out): playing the {len(recording.records)} records before that"
        )
    return recording


def _play_to(
    context: typer.Context, command: list[str], served: Replay, played: Sequence[Recording], as_json: bool
) -> int:
    """The command's own exit status, or 1 if it left the recording or did not play all of it."""
    try:
        wire = Wire(
            replay=addresses(served, played),
            played=tuple(Played.of(one.path) for one in played),
            differed=lambda: served.difference is not None,
        )
        status = _carry_out(context, command, wire, as_json)
    except InstrumentError:
        if served.difference is None:
            raise
        status = FELL_SHORT  # no instrument failed: the difference is the reason, and told alone
    finally:
        served.stop()  # not before the last messages of the command have arrived
        if served.difference is not None:
            tell(f"replay: {served.difference}")
    if served.difference is None and not served.complete:
        tell(f"replay: the command ended after {served.played} of {served.total} messages")
    return status if served.complete else status or FELL_SHORT


def _serve(served: Replay, resources: Mapping[str, str], as_json: bool) -> int:
    with stops_heard() as stopped:
        show(
            {"resources": {name: {"socket": address} for name, address in resources.items()}},
            as_json,
            lambda: table(("instrument", "socket"), resources.items()),
        )
        if not as_json:
            say("serving; Ctrl-C ends")
        while served.running and not stopped(0) and not served.ended.wait(POLL_S):
            pass
    if served.difference is not None:
        tell(f"replay: {served.difference}")
        return FELL_SHORT
    tell(f"replay: {served.played} of {served.total} messages were played")
    if served.complete:
        return DONE
    return INTERRUPTED


def _refuse_apart(command: list[str]) -> None:
    for words, remedy in APART.items():
        if command[: len(words)] == list(words):
            raise UsageError(f"labctl {' '.join(words)} cannot be recorded or replayed: {remedy}")


def _carry_out(context: typer.Context, command: list[str], wire: Wire, as_json: bool) -> int:
    words = [*command, "--json"] if as_json and "--json" not in command else command
    root = context.find_root()
    status = root.command.main(words, prog_name=root.info_name, standalone_mode=False, obj=wire)
    return status if isinstance(status, int) else DONE
