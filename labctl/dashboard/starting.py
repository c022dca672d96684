"""Starting a command from a page, which says what it is, and why it failed when it has ended."""

from collections.abc import Callable, Mapping, Sequence

from nicegui import ui

from labctl.dashboard import launcher
from labctl.dashboard.frame import REFRESH_S


def begin(
    words: Sequence[str],
    environment: Mapping[str, str],
    message: ui.label,
    leads_to: Callable[[int], str] = lambda _process: "",
) -> bool:
    """Start a command of labctl, with `environment` in addition to that of this process; whether it could be started.

    message: where it is said.
    leads_to: the address of the page that shows what that process does; empty until there is something to be seen.
    """
    try:
        started = launcher.start(words, environment)
    except OSError as error:
        message.set_text(str(error))
        return False
    message.set_text(launcher.in_words(words))

    def look() -> None:
        ended = started.process.poll() is not None  # asked first: what it did until then is there to be led to
        if address := leads_to(started.process.pid):
            looking.cancel()
            ui.navigate.to(address)
        elif ended:
            looking.cancel()
            message.set_text(started.failure())

    looking = ui.timer(REFRESH_S, look)
    return True
