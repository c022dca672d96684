"""The button of somebody who has seen that a laser is dark which did not go dark when told to."""

from nicegui import ui

from labctl.dashboard.monitor import WatchedRun
from labctl.dashboard.views import WatchedView
from labctl.runs.live.alarm import say_dark


class SeenDark:
    """There while the laser of a run or live view may still emit."""

    def __init__(self, watched: WatchedRun | WatchedView) -> None:
        """For one run or live view."""
        self._watched = watched
        self._row = ui.element("div").classes("seen")
        with self._row:
            ui.button("I have seen that the laser is dark", on_click=self._say, color=None).classes("seen-dark")
            self._message = ui.label().classes("message")
        self.refresh()

    def refresh(self) -> None:
        """Show it or not."""
        self._row.set_visibility(self._watched.state.alarm)

    def _say(self) -> None:
        try:
            say_dark(self._watched.directory)
        except OSError as error:
            self._message.set_text(f"cannot be written: {error.strerror}")
