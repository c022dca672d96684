"""Starting a command from a page, which says what it is, and why it failed when it has ended."""

from collections.abc import Callable, Sequence
from pathlib import Path

from nicegui import run, ui

from labctl.dashboard import launcher
from labctl.dashboard.frame import REFRESH_S
from labctl.dashboard.monitor import Watching
from labctl.printable import printable


async def begin(
    words: Sequence[str],
    watching: Watching,
    message: ui.label,
    leads_to: Callable[[], str] = str,
    station: str = "",
) -> bool:
    """Start a command of labctl for these runs; whether it could be started.

    message: where it is said.
    station: the station file it uses: while somebody has that bench, nothing is started; empty where it opens none.
    leads_to: the address of the page that shows what was begun; empty until there is something to be seen.
    """
    if station and (holder := await run.io_bound(watching.holder_of, Path(station))):
        message.set_text(printable(holder))
        return False
    try:
        started = launcher.start(words, watching.environment)
    except OSError as error:
        message.set_text(str(error))
        return False
    message.set_text(launcher.in_words(words))

    def look() -> None:
        ended = started.process.poll() is not None  # asked first: what it did until then is there to be led to
        if address := leads_to():
            looking.cancel()
            ui.navigate.to(address)
        elif ended:
            looking.cancel()
            message.set_text(started.failure())

    looking = ui.timer(REFRESH_S, look)
    return True
