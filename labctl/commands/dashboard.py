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
from labctl.errors import UsageError
from labctl.runs.format.store import location

if TYPE_CHECKING:
    from labctl.dashboard.server import Served

PORT = 8050
app = typer.Typer(add_completion=False, **PLAIN)


@app.command(help=__doc__)
def dashboard(
    context: typer.Context,
    folder: Annotated[
        Path | None, typer.Argument(metavar="FOLDER", help="Folder of run directories, or its URL.", parser=location)
    ] = None,
    runs: Annotated[
        Path | None, typer.Option("--runs", metavar="FOLDER", help="The same, by an option.", parser=location)
    ] = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="TCP port; 0 for any free one.")] = PORT,
    host: Annotated[
        str, typer.Option("--host", help="Address to listen at; default: this machine only.")
    ] = "127.0.0.1",
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False,
    as_json: JsonOption = False,
) -> int:
    """`labctl dashboard`."""
    if folder is not None and runs is not None:
        raise UsageError(f"{folder} and --runs {runs}: two folders: name one")
    shown = folder or runs or Path("runs")
    if find_spec("nicegui") is None:
        raise UsageError("the dashboard needs NiceGUI: pip install 'photonic-labctl[dashboard]'")
    from labctl.dashboard.guard import is_loopback
    from labctl.dashboard.launch_page import opened
    from labctl.dashboard.server import PortTaken, serve

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
        served_at = {"url": link, "host": served.host, "port": served.port, "runs": str(shown)}
        show(served_at, as_json, lambda: say(f"{link}\nCtrl-C ends the dashboard; runs go on without it"))
        sys.stdout.flush()
        with ExitStack() as while_served:
            if not no_open:
                try:
                    while_served.enter_context(opened(served.link))
                except OSError as error:
                    sys.stderr.write(f"labctl: no browser is opened ({error.filename}: {error.strerror})\n")
            yield

    try:
        serve(shown, host, port, access_of(context).wire.environment(), ready)
    except PortTaken as error:
        raise UsageError(f"{error}: name another --port, or the --host of this machine") from None
    except KeyboardInterrupt:
        pass
    return DONE
