"""The page of one run.

A page asks for what is new a few times a second while it is open, and sends to the browser only what has changed.
"""

from nicegui import ui

from labctl.dashboard import wording
from labctl.dashboard.frame import REFRESH_S, Region, frame, heading, say_elsewhere, show_missing
from labctl.dashboard.frame import refresh as refresh_all
from labctl.dashboard.instruments_panel import show_instruments
from labctl.dashboard.list_wording import comparison_address, quoted, run_address
from labctl.dashboard.listing import Wanted
from labctl.dashboard.live_page import show_signals
from labctl.dashboard.monitor import WatchedRun, Watching
from labctl.dashboard.notes_panel import NotesPanel, notes_of
from labctl.dashboard.resume_panel import ResumePanel
from labctl.dashboard.seen_dark import SeenDark
from labctl.dashboard.state import Phase
from labctl.runs.asking import stop_at_once, tell
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import is_elsewhere
from labctl.runs.index import origin_of
from labctl.runs.live.control_file import Word
from labctl.runs.live.owner import Writer, writer_of


def show_run(watching: Watching, name: str) -> None:
    """One run, live while it is running."""
    watched = watching.run(name)
    if watched is None:
        show_missing(watching, name)
        return
    watched.look()
    frame(watching, name, origin_of(watched.manifest), own=run_address(name))
    with ui.element("main").classes("run"):
        with ui.element("section").classes("top"):
            regions = [
                Region("emission", lambda: wording.emission(watched.state)),
                Region("progress", lambda: wording.progress(watched.state, watched.records)),
            ]
            controls: list[SeenDark | Buttons | ResumePanel | NotesPanel] = []
            if is_elsewhere(watched.directory):
                say_elsewhere(watched.directory, "stop it, resume it or write notes on it where it was measured")
            else:
                controls += [SeenDark(watched), Buttons(watched)]
                controls += [ResumePanel(watching, watched.directory, lambda: _is_cut_short(watched))]
        with ui.element("section").classes("traces"):
            heading("Last shot with light")
            regions.append(Region("ports", lambda: wording.traces(watched.latest)))
        with ui.element("section").classes("dmd"):
            heading("Picture of this shot")
            regions.append(Region("picture", lambda: wording.image(watched.shown)))
        with ui.element("section"):
            heading("Instruments")
            regions.append(Region("instruments", lambda: wording.instruments(watched.state, watched.manifest)))
        with ui.element("section"):
            heading("Accuracy as it grows")
            regions.append(Region("accuracy", lambda: wording.accuracy(watched.curve())))
        with ui.element("section").classes("wide"):
            heading("Readout that follows: each image predicted, then learnt")
            regions.append(Region("following", lambda: wording.following(watched.following(), watched.curve().chance)))
        with ui.element("section").classes("wide"):
            noted = [] if is_elsewhere(watched.directory) else [watched.directory]
            show_signals(watched, Origin.of(watched.manifest), noted)
        with ui.element("section").classes("wide"):
            heading("Log, UTC")
            regions.append(Region("log", lambda: wording.log(watched.state, watched.problem)))
        with ui.element("section").classes("wide"):
            heading("Instrument by instrument: set, read back, said")
            regions += show_instruments(watched)
        with ui.element("section").classes("wide notes"):
            heading("Notes")
            if is_elsewhere(watched.directory):
                ui.html(notes_of(watched.directory) or wording.nothing("none"), sanitize=False)
            else:
                controls.append(NotesPanel(watched.directory, watching.listing.look_again))
        with ui.element("section").classes("wide"):
            _show_next(watching, name, watched)

    def refresh() -> None:
        watched.look()
        refresh_all(regions)
        for control in controls:
            control.refresh()

    ui.timer(REFRESH_S, refresh)


def _is_cut_short(watched: WatchedRun) -> bool:
    """Whether records are missing that nobody measures."""
    done, total = watched.records
    return done < total and not watched.state.running


class Buttons:
    """Pause, go on, stop, and stop now: there while the run is running."""

    def __init__(self, watched: WatchedRun) -> None:
        """Buttons for one run."""
        self._watched = watched
        self._row = ui.element("div").classes("buttons")
        with self._row:
            self._pause = ui.button("Pause", on_click=self._toggle, color=None).classes("pause")
            ui.button("Stop", on_click=lambda: self._ask(Word.STOP), color=None).classes("stop")
            ui.button("Stop now", on_click=lambda: self._ask(Word.STOP_NOW), color=None).classes("stop-now")
            self._message = ui.label().classes("message")
        self._asked_in: Phase | None = None
        self.refresh()

    def refresh(self) -> None:
        """Show what can be asked now."""
        phase = self._watched.state.phase
        self._row.set_visibility(self._watched.state.running)
        self._pause.set_text("Go on" if phase is Phase.PAUSED else "Pause")
        if self._asked_in is not None and phase is not self._asked_in:
            self._asked_in = None
            self._message.set_text("")

    def _toggle(self) -> None:
        self._ask(Word.GO_ON if self._watched.state.phase is Phase.PAUSED else Word.PAUSE)

    def _ask(self, word: Word) -> None:
        directory = self._watched.directory
        try:
            if word is Word.STOP_NOW:
                stop_at_once(directory, _to_signal(writer_of(RunPaths(directory))))
            else:
                tell(directory, word)
        except OSError as error:
            self._message.set_text(f"cannot be asked: {error.strerror}")
            return
        self._asked_in = self._watched.state.phase
        self._message.set_text(f"asked to {word}")


def _to_signal(writer: Writer | None) -> int | None:
    return writer.process if writer is not None and writer.heeds_signals else None


def _show_next(watching: Watching, name: str, watched: WatchedRun) -> None:
    """What can be done with a run: its report, and comparing it with another run."""
    if watched.report.is_file():
        ui.link("Open the report", f"/report/{quoted(name)}", new_tab=True).classes("report")
    latest = (one.row.name for one in watching.listing.runs(Wanted()).found)
    others = [one for one in latest if one != name and one.isprintable()]
    if others:
        other = ui.select(others, label="Compare with", with_input=True, new_value_mode="add").classes("compare")
        other.on_value_change(lambda event: ui.navigate.to(f"/{comparison_address(name, event.value)}"))
