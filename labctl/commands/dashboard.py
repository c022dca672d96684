"""Show running and past runs in a browser: watch, pause, stop, compare. Ctrl-C ends it; runs go on."""

import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from labctl.commands.access import access_of
from labctl.commands.command_group import PLAIN
from labctl.commands.exit_status import DONE
from labctl.commands.output import JsonOption, say, show, warn
from labctl.errors import LabctlError, UsageError
from labctl.runs.format.store import is_elsewhere, location

if TYPE_CHECKING:
    from labctl.dashboard.server import Served

PORT = 8050
app = typer.Typer(add_completion=False, **PLAIN)


@app.command(help=__doc__)
def dashboard(
    context: typer.Context,
    folder: Annotated[
        Path, typer.Argument(metavar="FOLDER", help="Folder of run directories, or its URL.", parser=location)
    ] = Path("runs"),
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="TCP port; 0 for any free one.")] = PORT,
    host: Annotated[
        str, typer.Option("--host", help="Address to listen at; default: this machine only.")
    ] = "127.0.0.1",
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False,
    as_json: JsonOption = False,
) -> int:
    """`labctl dashboard`."""
    if not host.strip():
        raise UsageError("--host: is empty: name an address of this machine, or leave it out")
    if not is_elsewhere(folder) and folder.exists() and not folder.is_dir():
        raise UsageError(f"{folder}: is no folder: name one of runs")
    if find_spec("nicegui") is None:
        raise UsageError('the dashboard needs NiceGUI: pip install "photonic-labctl[dashboard]"')
    from labctl.bench.drivers import sent_anew
    from labctl.bench.lock import in_use
    from labctl.bench.station import read_station
    from labctl.dashboard.guard import is_loopback
    from labctl.dashboard.launch_page import opened
    from labctl.dashboard.server import PortTaken, serve
    from labctl.studies.queue.work import ask, settle

    if not is_loopback(host):
        warn(
            f"--host {host}: other machines reach this page, and its address travels unencrypted: whoever reads it can "
            "stop and start runs; leave --host out unless that network is yours"
        )

    @contextmanager
    def ready(served: "Served") -> Iterator[None]:
        def show_next() -> None:
            sys.stderr.write(f"labctl: a browser was let in; a link for another one: {served.link(show_next)}\n")

        link = served.link(show_next)
        served_at = {"url": link, "host": served.host, "port": served.port, "runs": str(folder)}

        def for_people() -> None:
            say(link)
            say("Ctrl-C ends the dashboard; runs go on without it")

        show(served_at, as_json, for_people)
        sys.stdout.flush()
        with ExitStack() as while_served:
            if not no_open:
                try:
                    while_served.enter_context(opened(served.link))
                except OSError as error:
                    sys.stderr.write(f"labctl: no browser is opened ({error.filename}: {error.strerror})\n")
            yield

    wire = access_of(context).wire

    def holder_of(station: Path) -> str:
        try:
            return in_use(read_station(station), wire)
        except LabctlError:  # which the command that is started says
            return ""

    try:
        serve(folder, host, port, wire.environment(), holder_of, settle, ask, sent_anew, ready)
    except PortTaken as error:
        raise UsageError(f"{error}: name another --port, or the --host of this machine") from None
    except KeyboardInterrupt:
        pass
    return DONE
