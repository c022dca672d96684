"""The pages: the list of runs, one run, two runs side by side.

A page asks for what is new a few times a second while it is open, and sends to the browser only what has changed.
"""

from urllib.parse import quote

from nicegui import ui

from labctl.dashboard import launcher, wording
from labctl.dashboard.live_page import show_signals
from labctl.dashboard.monitor import WatchedRun, Watching
from labctl.dashboard.page_parts import Region
from labctl.dashboard.page_parts import frame as _frame
from labctl.dashboard.page_parts import heading as _heading
from labctl.dashboard.page_parts import refresh as _refresh
from labctl.dashboard.state import ENDED, Phase
from labctl.runs.format.layout import RunPaths
from labctl.runs.live.alarm import say_dark
from labctl.runs.live.control_file import Word, ask, stop_at_once
from labctl.runs.live.owner import Writer, writer_of
from labctl.runs.read.differences import settings_that_differ

REFRESH_S = 0.4


def show_list(watching: Watching) -> None:
    """All runs, those that are running first, and the form that starts one."""
    _frame(f"Runs in {watching.folder}")

    def live() -> str:
        found = [(name, watched) for name in watching.running() if (watched := watching.run(name)) is not None]
        for _, watched in found:
            watched.look()
        return wording.live(found)

    with ui.element("main").classes("list"):
        regions = [Region("alarms", lambda: wording.alarms(watching.alarms()))]
        with ui.element("section"):
            _heading("Running")
            regions.append(Region("live", live))
        with ui.element("section"):
            _heading("Runs")
            example = "words, or: images >= 300 and tag = good"
            wanted = ui.input("Search", placeholder=example).classes("filter")
            regions.append(Region("all", lambda: wording.run_list(watching.search(wanted.value or ""))))
            wanted.on_value_change(regions[-1].refresh)
        with ui.element("section"), ui.expansion("Start a run").classes("begin"):
            _show_form(watching)
    ui.timer(REFRESH_S, lambda: _refresh(regions))


def _show_form(watching: Watching) -> None:
    with ui.element("div").classes("form"):
        names = launcher.protocols()
        usual = launcher.USUAL if launcher.USUAL in names else names[0]
        protocol = ui.select(names, value=usual, label="Protocol").classes("protocol")
        station = ui.input("Station file", placeholder="empty: the simulated bench").classes("station")
        settings = ui.textarea("Settings", placeholder="images=400\nwindow=1 ns").props("rows=3").classes("settings")
        attended = ui.checkbox("somebody stands at the laser's key switch (--attended)")
        with ui.element("div").classes("arm"):
            armed = ui.switch("light may be switched on (--arm)").classes("armed")
            button = ui.button("Start", color=None).classes("start")
        message = ui.label().classes("message")

    def begin() -> None:
        asked = launcher.Asked(
            str(protocol.value),
            settings.value or "",
            (station.value or "").strip(),
            armed=bool(armed.value),
            attended=bool(attended.value),
        )
        directory = launcher.new_directory(watching.folder, asked)
        try:
            started = launcher.start(asked, directory, watching.environment)
        except (OSError, ValueError) as error:
            message.set_text(str(error))
            return
        armed.set_value(False)
        message.set_text(launcher.in_words(asked, directory))

        def follow() -> None:
            watching.forget_list()
            if watching.run(directory.name) is not None:
                waiting.cancel()
                ui.navigate.to(f"/run/{directory.name}")
            elif failure := started.failure():
                waiting.cancel()
                message.set_text(failure)

        waiting = ui.timer(REFRESH_S, follow)

    button.on_click(begin)


def show_run(watching: Watching, name: str) -> None:
    """One run, live while it is running."""
    watched = watching.run(name)
    if watched is None:
        show_missing(watching, name)
        return
    watched.look()
    _frame(name)
    with ui.element("main").classes("run"):
        with ui.element("section").classes("top"):
            regions = [
                Region("emission", lambda: wording.emission(watched.state)),
                Region("progress", lambda: wording.progress(watched.state, watched.records)),
            ]
            seen = SeenDark(watched)
            buttons = Buttons(watched)
        with ui.element("section").classes("traces"):
            _heading("Last shot with light")
            regions.append(Region("ports", lambda: wording.traces(watched.latest, watched.sample_interval_s)))
        with ui.element("section").classes("dmd"):
            _heading("Picture of this shot")
            regions.append(Region("picture", lambda: wording.image(watched.shown)))
        with ui.element("section"):
            _heading("Instruments")
            regions.append(Region("instruments", lambda: wording.instruments(watched.state, watched.manifest)))
        with ui.element("section"):
            _heading("Accuracy as it grows")
            regions.append(Region("accuracy", lambda: wording.accuracy(watched.curve())))
        with ui.element("section").classes("wide"):
            _heading("Readout that follows: each image predicted, then learnt")
            regions.append(Region("following", lambda: wording.following(watched.following(), watched.curve().chance)))
        with ui.element("section").classes("wide"):
            show_signals(watched.directory)
        with ui.element("section").classes("wide"):
            _heading("Log, UTC")
            regions.append(Region("log", lambda: wording.log(watched.state, watched.problem)))
        with ui.element("section").classes("wide"):
            _show_next(watching, name, watched)

    def refresh() -> None:
        watched.look()
        _refresh(regions)
        seen.refresh()
        buttons.refresh()

    ui.timer(REFRESH_S, refresh)


class SeenDark:
    """The button of somebody who has seen that the laser is dark: there while it may still emit."""

    def __init__(self, watched: WatchedRun) -> None:
        """For one run."""
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
        self._row.set_visibility(phase not in ENDED and phase is not Phase.UNKNOWN)
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
                ask(directory, word)
        except OSError as error:
            self._message.set_text(f"cannot be asked: {error.strerror}")
            return
        self._asked_in = self._watched.state.phase
        self._message.set_text(f"asked to {word}")


def _to_signal(writer: Writer | None) -> int | None:
    return writer.process if writer is not None and writer.heeds_signals else None


def _show_next(watching: Watching, name: str, watched: WatchedRun) -> None:
    """What can be done with a run: its report, and comparing it with another run."""
    report = RunPaths(watched.directory).report
    if report.is_file():
        ui.link("Open the report", f"/report/{quote(name, safe='')}", new_tab=True).classes("report")
    others = [row.name for row in watching.rows() if row.name != name and row.name.isprintable()]
    if others:
        other = ui.select(others, label="Compare with", with_input=True).classes("compare")
        other.on_value_change(
            lambda event: ui.navigate.to(f"/compare/{quote(name, safe='')}/{quote(event.value, safe='')}")
        )


def show_comparison(watching: Watching, one: str, other: str) -> None:
    """Two runs: settings that differ, last traces and accuracy curves over each other."""
    first, second = watching.run(one), watching.run(other)
    if first is None or second is None:
        show_missing(watching, one if first is None else other)
        return
    for watched in (first, second):
        watched.look()
    _frame("Two runs")
    with ui.element("main").classes("comparison"):
        with ui.element("section").classes("wide"):
            _heading("Settings that differ")
            found = settings_that_differ(first.manifest, second.manifest)
            ui.html(wording.differing(found, one, other), sanitize=False)
        with ui.element("section").classes("wide traces"):
            _heading("Last shots with light")
            regions = [Region("ports", lambda: wording.traces(first.latest, first.sample_interval_s, second.latest))]
        with ui.element("section").classes("wide"):
            _heading("Accuracy as it grows")
            regions.append(Region("accuracy", lambda: wording.accuracy(first.curve(), second.curve())))

    def refresh() -> None:
        for watched in (first, second):
            watched.look()
        _refresh(regions)

    ui.timer(REFRESH_S, refresh)


def show_missing(watching: Watching, name: str) -> None:
    """There is no such run."""
    _frame("No such run")
    with ui.element("main"):
        ui.label(f"{watching.folder} has no run {name}.")
        ui.link("All runs", "/")
