"""Serving the dashboard, to whoever has a link, until it is stopped."""

import asyncio
import os
import socket
from collections.abc import Callable, Iterable, Mapping
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast
from urllib.parse import unquote

os.environ.setdefault("MATPLOTLIB", "false")  # NiceGUI looks for it: half a second for nothing

import uvicorn
from fastapi import FastAPI, HTTPException, Request
from fastapi.responses import HTMLResponse
from nicegui import ui
from nicegui.run import io_bound as in_a_thread

from labctl.dashboard import live_page, pages
from labctl.dashboard.comparison_page import show_comparison
from labctl.dashboard.frame import show_elsewhere, show_unread
from labctl.dashboard.guard import Guard
from labctl.dashboard.list_page import show_list
from labctl.dashboard.listing import Wanted
from labctl.dashboard.monitor import Watching
from labctl.dashboard.queue_page import show_queue
from labctl.dashboard.sessions import Sessions
from labctl.dashboard.start_page import show_start
from labctl.dashboard.strangers import Strangers, recognising
from labctl.dashboard.sweep_pages import show_sweep, show_sweeps
from labctl.errors import LabctlError
from labctl.runs.format.own_files import read_own
from labctl.runs.format.store import is_elsewhere
from labctl.runs.queue import Item, Queue, Wish

REPORT_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'; sandbox; frame-ancestors 'none'"
"""A report is a picture book; that of a stranger's run may try to be more."""
MOST_OF_A_REPORT = 1 << 27
MOST_PATIENT_S = 600.0
"""A page of runs elsewhere is shown when they were read, and thousands are read when they are listed first."""


@dataclass(frozen=True)
class Served:
    """Where the dashboard is."""

    address: str
    host: str
    port: int
    sessions: Sessions

    def link(self, used: Callable[[], None]) -> str:
        """An address that lets one browser in, once; then `used` is called."""
        return f"{self.address}/?token={self.sessions.invite(used)}"


class PortTaken(Exception):
    """Something else listens there."""


def serve(
    folder: Path,
    host: str,
    port: int,
    environment: Mapping[str, str],
    holder_of: Callable[[Path], str],
    settle: Callable[[Queue], list[Item]],
    ask: Callable[[Queue, Wish], None],
    sent_anew: Callable[[Mapping[str, Any]], Iterable[str]],
    ready: Callable[[Served], AbstractContextManager[None]],
) -> None:
    """Serve the runs in `folder` at `host` and `port` (0: any free one), within `ready`, until a signal.

    A run that is started from the page has `environment` in addition to that of this process; none is while
    `holder_of` its station file names somebody who has the bench. `settle` gives the items of a queue, where what
    ran when whoever carried it out died waits again; `ask` asks whoever carries it out for something.
    `sent_anew` gives the settings in a manifest that its run sent before the first record, as patterns of names.

    Raises:
        PortTaken: the port is not free, or the address is not one of this machine.
        LabctlError: the folder is elsewhere and does not answer.
    """
    try:
        listener = socket.create_server(
            (host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET, reuse_port=False
        )
    except OSError as error:
        raise PortTaken(f"{host}:{port}: cannot be listened at ({error.strerror})") from None
    with listener:
        bound = listener.getsockname()[1]
        sessions = Sessions()
        watching = Watching(folder, environment, holder_of, settle, ask, sent_anew)
        watching.look_elsewhere()
        app = _application(watching)
        names = (socket.gethostname(), socket.getfqdn())
        guard = Guard(recognising(app), host=host, names=names, port=bound, sessions=sessions)
        named = f"[{host}]" if ":" in host else socket.gethostname() if host in ("0.0.0.0", "::") else host  # noqa: S104
        served = Served(f"http://{named}:{bound}", host, bound, sessions)
        while_served = ExitStack()
        app.router.on_startup.append(lambda: while_served.enter_context(ready(served)))
        app.router.on_shutdown.append(while_served.close)
        config = uvicorn.Config(
            guard,
            # a method that is called for each connection, as a class would be
            http=cast(type[asyncio.Protocol], Strangers().protocol),
            log_level="critical",
            access_log=False,
            lifespan="on",
            timeout_graceful_shutdown=1,
            server_header=False,
            proxy_headers=False,
        )
        try:
            uvicorn.Server(config).run(sockets=[listener])
        finally:
            watching.learning.close()


def _application(watching: Watching) -> FastAPI:
    app = FastAPI(openapi_url=None, docs_url=None, redoc_url=None)

    one_at_a_time = asyncio.Lock()

    async def looked(show: Callable[[], None], *names: str) -> None:
        """Show a page of these runs, once they were read if they are elsewhere; or why they cannot be."""
        if is_elsewhere(watching.folder):
            try:
                async with one_at_a_time:
                    await in_a_thread(watching.look_elsewhere, *names)
            except LabctlError as error:
                show_unread(watching, str(error))
                return
        show()

    def only_here(title: str, show: Callable[[], None]) -> None:
        """Show a page that makes runs, which is done in a folder on this machine."""
        if is_elsewhere(watching.folder):
            show_elsewhere(watching, title)
        else:
            show()

    @app.get("/report/{name:path}")
    def report(name: str) -> HTMLResponse:
        watched = watching.run(unquote(name))
        if watched is None:
            raise HTTPException(404)
        try:
            content = read_own(watched.report, MOST_OF_A_REPORT)
        except (OSError, LabctlError):
            raise HTTPException(404) from None
        return HTMLResponse(content, headers={"content-security-policy": REPORT_POLICY})

    @ui.page("/", response_timeout=MOST_PATIENT_S)
    async def runs(request: Request) -> None:
        await looked(lambda: show_list(watching, Wanted.of(request.query_params)))

    @ui.page("/start")
    def start() -> None:
        only_here("Start a run", lambda: show_start(watching))

    @ui.page("/queue")
    def queue() -> None:
        only_here("Queue", lambda: show_queue(watching))

    @ui.page("/sweeps", response_timeout=MOST_PATIENT_S)
    async def sweeps() -> None:
        await looked(lambda: show_sweeps(watching))

    @ui.page("/sweep/{name}", response_timeout=MOST_PATIENT_S)
    async def sweep(name: str) -> None:
        await looked(lambda: show_sweep(watching, name))

    @ui.page("/run/{name:path}", response_timeout=MOST_PATIENT_S)
    async def run(name: str) -> None:
        asked = unquote(name)
        await looked(lambda: pages.show_run(watching, asked), asked)

    @ui.page("/live")
    def live() -> None:
        only_here("Live", lambda: live_page.show_live(watching))

    @ui.page("/live/{name}")
    def view(name: str) -> None:
        only_here("Live", lambda: live_page.show_one(watching, name))

    @ui.page("/compare/{one}/{other}", response_timeout=MOST_PATIENT_S)
    async def compare(one: str, other: str) -> None:
        names = unquote(one), unquote(other)
        await looked(lambda: show_comparison(watching, *names), *names)

    ui.run_with(
        app, title="labctl", dark=None, tailwind=False, binding_refresh_interval=0.2, show_welcome_message=False
    )
    return app
