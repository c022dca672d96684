"""Going on with a run or a sweep that ended early."""

from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from labctl.dashboard.launcher import to_resume
from labctl.dashboard.monitor import Watching
from labctl.dashboard.starting import begin


class ResumePanel:
    """The form of `labctl resume`: there while something is missing and nobody measures it."""

    def __init__(self, watching: Watching, directory: Path, is_needed: Callable[[], bool]) -> None:
        """For the run or sweep in `directory`."""
        self._watching = watching
        self._directory = directory
        self._is_needed = is_needed
        self._row = ui.element("div").classes("form resume")
        with self._row:
            self._station = ui.input("Station file", placeholder="empty: the one it was begun with").classes("station")
            self._attended = ui.checkbox("somebody stands at the laser's key switch (--attended)")
            with ui.element("div").classes("arm"):
                self._armed = ui.switch("light may be switched on (--arm)")
                ui.button("Resume", on_click=self._resume, color=None).classes("start")
            self._message = ui.label().classes("message")
        self.refresh()

    def refresh(self) -> None:
        """Show it or not."""
        self._row.set_visibility(self._is_needed())

    async def _resume(self) -> None:
        station = (self._station.value or "").strip()
        armed, attended = bool(self._armed.value), bool(self._attended.value)
        words = to_resume(self._directory, station, armed=armed, attended=attended)
        self._armed.set_value(False)
        if await begin(words, self._watching, self._message, station=station):
            self._watching.listing.look_again()
