"""The page of the live view: light and its controls, and the panels, which a run's page has too."""

from collections.abc import Callable, Sequence
from contextlib import suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from nicegui import ui
from nicegui.run import io_bound as in_a_thread

from labctl.dashboard import panels, wording
from labctl.dashboard.frame import Region, frame, heading, refresh, show_missing
from labctl.dashboard.launcher import allowed
from labctl.dashboard.monitor import WatchedRun, Watching
from labctl.dashboard.panels import PANELS, Choice
from labctl.dashboard.run_sight import RunSight
from labctl.dashboard.seen_dark import SeenDark
from labctl.dashboard.starting import begin
from labctl.dashboard.state import Emission
from labctl.dashboard.views import WatchedView, view_going_on, views_in
from labctl.errors import RunError
from labctl.printable import printable
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.index import run_directories
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.sight import LIVE, Sight, Wishes, ask_for, look_at, wishes_in
from labctl.runs.notes import say_of

REFRESH_S = 0.1
REFRESH_OF_RUN_S = 0.18
"""Five times a second and more, and no more than that of the time of a run."""
LOOKED_EVERY_S = 1.0
"""A page that is open somewhere says so."""
UNWATCHED = "10 min"
"""After which a view goes dark whose page is open nowhere: the light is invisible, and who started it has gone. Long
enough to load the page anew, or to open it beside the bench."""
MOST_RUNS = 50
"""The latest: one of them is noted something of."""
SLOWER = 4
"""Panels that are read rather than followed are drawn anew after so many of the others."""
STYLE = (Path(__file__).parent / "live.css").read_text(encoding="utf-8")
SCRIPT = f"<script>{(Path(__file__).parent / 'tone.js').read_text(encoding='utf-8')}</script>"


class Panels:
    """The panels of what is seen, with the choice of scale and part of the traces, the tone, and pictures for notes."""

    def __init__(self, sight: Callable[[], Sight | None], runs: Sequence[Path], origin: Callable[[], Origin]) -> None:
        """Show what `sight` says, which is of `origin`; a picture of it can be put into the notes of one of `runs`."""
        ui.add_head_html(f"<style>{STYLE}</style>{SCRIPT}")
        self._sight = sight
        self._origin = origin
        self._drawn: tuple[Sight | None, Choice] | None = None
        self._choice = Choice()
        contents: dict[str, Callable[[], str]] = {
            "levels": lambda: panels.levels(self._sight()),
            "signals": lambda: panels.signals(self._sight(), self._choice),
            "codes": lambda: panels.codes(self._sight()),
            "spectrum": lambda: panels.frequencies(self._sight()),
            "repeats": lambda: panels.repeats(self._sight()),
            "course": lambda: panels.course(self._sight()),
        }
        self._quick: list[Region] = []
        self._slow: list[Region] = []
        self._turn, self._stale = 0, False
        for panel in PANELS:
            with ui.element("section").classes("wide" if panel.quick else "half"):
                heading(panel.title)
                region = Region(panel.name, contents[panel.name])
                (self._quick if panel.quick else self._slow).append(region)
                if panel.name == "levels":
                    self._show_tone()
                elif panel.name == "signals":
                    self._show_scales()

        if runs:
            with ui.element("section").classes("wide"):
                self._show_notes(runs)

    def _show_notes(self, runs: Sequence[Path]) -> None:
        heading("A picture of this into the notes of a run")
        with ui.element("div").classes("row noting"):
            names = {one.name: printable(one.name) for one in runs}
            run = ui.select(names, value=runs[0].name, label="Run").classes("noted-run")
            text = ui.input("Note with the picture", placeholder="fibre 3 coupled anew").classes("noted-text")
            button = ui.button("Keep a picture", color=None).classes("keep")
        message = ui.label().classes("message")

        async def keep() -> None:
            sight = self._sight()
            directory = next(one for one in runs if one.name == run.value)
            if sight is None:
                message.set_text("nothing is seen yet")
                return
            try:
                await in_a_thread(partial(_keep, directory, (text.value or "").strip(), sight, self._origin))
            except RunError as error:
                message.set_text(str(error))
            else:
                message.set_text(f"kept in the notes of {names[directory.name]}")
                text.set_value("")

        button.on_click(keep)

    def refresh(self) -> None:
        """Draw anew what has changed; numbers that are read and not followed only every few times."""
        now = self._sight(), self._choice
        if self._drawn is None or now[0] is not self._drawn[0] or now[1] != self._drawn[1]:
            self._drawn, self._stale = now, True
            refresh(self._quick)
        if self._stale and self._turn % SLOWER == 0:
            self._stale = False
            refresh(self._slow)
        self._turn += 1

    def _show_tone(self) -> None:
        with ui.element("div").classes("row"):
            which = ui.number("Tone of bar number", value=1, min=1, precision=0).classes("tone-port")
            ui.button("Tone", color=None).classes("tone").on("click", js_handler="() => labctlTone.toggle()")
        which.on_value_change(lambda event: ui.run_javascript(f"labctlTone.row = {int(event.value or 1) - 1}"))

    def _show_scales(self) -> None:
        with ui.element("div").classes("row scales"):
            free = ui.switch("each on a scale of its own").classes("free")
            part = ui.range(min=0, max=100, value={"min": 0, "max": 100}, step=1).classes("part")
            part.props('label aria-label="part of the trace, %"')
            whole = ui.button("Whole trace", color=None).classes("whole")

        def choose() -> None:
            low, high = part.value["min"], max(part.value["max"], part.value["min"] + 1)
            self._choice = Choice(bool(free.value), (low / 100, high / 100))
            self.refresh()

        free.on_value_change(choose)
        part.on_value_change(choose)
        whole.on_click(lambda: part.set_value({"min": 0, "max": 100}))


def _keep(directory: Path, text: str, sight: Sight, origin: Callable[[], Origin]) -> None:
    from labctl.reports.figures.signals import signals_png  # matplotlib, which only a picture needs

    title = f"{directory.name}, {datetime.now(UTC):%d %b %Y %H:%M:%S} UTC"
    say_of(RunPaths(directory), text, picture=signals_png(sight, title, origin()))


def show_signals(watched: WatchedRun, origin: Origin, noted: Sequence[Path]) -> None:
    """The panels of a run on a bench of `origin`, for the notes of the runs `noted`; read while they are unfolded."""
    unfolded = ui.expansion("Signals: levels, codes, spectrum, repeatability, drift").classes("signals")
    seen: list[tuple[RunSight, Panels]] = []

    def look() -> None:
        if not unfolded.value:
            return
        if not seen:
            sight = RunSight(watched.directory)
            with unfolded, ui.element("div").classes("live"):
                seen.append((sight, Panels(lambda: sight.sight, noted, lambda: origin)))
        sight, shown = seen[0]
        sight.look()
        shown.refresh()

    def say_so() -> None:
        if unfolded.value and watched.state.running:
            _say_looking(watched.directory)

    ui.timer(REFRESH_OF_RUN_S, look)
    ui.timer(LOOKED_EVERY_S, say_so)


def _say_looking(directory: Path) -> None:
    with suppress(OSError):  # of somebody else's, who looks for himself
        look_at(directory)


class Controls:
    """Light, its power and wavelength, and the drive: off at once, on only behind the arm switch."""

    def __init__(self, view: WatchedView) -> None:
        """For one live view."""
        self._view = view
        self._element = ui.element("div")
        with self._element:
            self._show(wishes_in(view.directory))
        self.refresh()

    def refresh(self) -> None:
        """They are there while the view is going on."""
        self._element.set_visibility(self._view.state.running)

    def _show(self, wished: Wishes) -> None:
        with ui.element("div").classes("row controls"):
            self._off = ui.button("Laser off", on_click=lambda: self._ask(Word.PAUSE), color=None).classes("off")
            ui.button("End", on_click=lambda: self._ask(Word.STOP), color=None).classes("end")
            ui.button("Ranges and peaks anew", on_click=self._anew, color=None).classes("anew")
            self._armed = ui.switch("light may be switched on").classes("armed")
        with ui.element("div").classes("row controls behind"):
            on = ui.button("Laser on", on_click=lambda: self._ask(Word.GO_ON), color=None).classes("on")
            self._power = ui.input("Power", value=wished.power, placeholder="3 mW").classes("power")
            self._wavelength = ui.input("Wavelength", value=wished.wavelength, placeholder="1550 nm").classes(
                "wavelength"
            )
            put = ui.button("Set", on_click=self._set, color=None).classes("set")
            self._drive = ui.switch("drive", value=wished.drive, on_change=self._set).classes("drive")
        for control in (on, self._power, self._wavelength, put, self._drive):
            control.bind_enabled_from(self._armed, "value")
        self._message = ui.label().classes("message")

    def _ask(self, word: Word) -> None:
        self._write(partial(ask, self._view.directory, word))

    def _anew(self) -> None:
        wished = wishes_in(self._view.directory)
        self._write(partial(ask_for, self._view.directory, wished.model_copy(update={"anew": wished.anew + 1})))

    def _set(self) -> None:
        wished = wishes_in(self._view.directory).model_copy(
            update={
                "power": (self._power.value or "").strip()[:40],
                "wavelength": (self._wavelength.value or "").strip()[:40],
                "drive": bool(self._drive.value),
            }
        )
        self._write(partial(ask_for, self._view.directory, wished))

    def _write(self, write: Callable[[], None]) -> None:
        try:
            write()
        except OSError as error:
            self._message.set_text(f"cannot be asked: {error.strerror}")


def show_live(watching: Watching) -> None:
    """The live view that began last of those that are going on among these runs; the form that starts one."""
    view = view_going_on(watching.folder)
    if view is None:
        frame(watching, "Live")
        with ui.element("main").classes("run live"), ui.element("section").classes("wide"):
            _show_form(watching)
        return
    _show_view(watching, view, "Live")

    def follow() -> None:
        if not view.state.running and view_going_on(watching.folder) is not None:
            ui.navigate.to("/live")

    ui.timer(LOOKED_EVERY_S, follow)


def show_one(watching: Watching, name: str) -> None:
    """One live view, which may have ended: its laser may emit."""
    directory = next((one for one in views_in(watching.folder) if one.name == name), None)
    if directory is None:
        show_missing(watching, f"{LIVE}/{name}")
        return
    view = WatchedView(directory)
    view.look()
    _show_view(watching, view, f"Live view {name}")


def _show_view(watching: Watching, view: WatchedView, title: str) -> None:
    frame(watching, title, view.origin, own=view.address)
    with ui.element("main").classes("run live"):
        with ui.element("section").classes("top"):
            about = [
                Region("emission", lambda: wording.emission(view.state)),
                Region("bench", lambda: panels.about(view.state)),
            ]
            controls: list[SeenDark | Controls] = [SeenDark(view), Controls(view)]
        about.append(Region("old", lambda: panels.old(view.state, view.sight)))
        latest = run_directories(watching.folder)[: -MOST_RUNS - 1 : -1]
        seen = Panels(lambda: view.sight, latest, lambda: view.origin)
        with ui.element("section").classes("wide"):
            heading("Log, UTC")
            about.append(Region("log", lambda: wording.log(view.state)))

    def look() -> None:
        before = view.sight
        view.look()
        if before is not None and view.sight is not None and before.looks == view.sight.looks:
            view.sight = before
        refresh(about)
        for control in controls:
            control.refresh()
        seen.refresh()
        timer.interval = REFRESH_S if view.state.running else LOOKED_EVERY_S

    def say_so() -> None:
        if view.state.running:
            _say_looking(view.directory)

    ui.timer(LOOKED_EVERY_S, say_so)
    timer = ui.timer(REFRESH_S, look)


def _show_form(watching: Watching) -> None:
    heading("Start a live view: the light goes on, and the channels are measured again and again, without a run")
    for last in map(WatchedView, views_in(watching.folder)[-1:]):
        state = last.look()
        if state.emission is not Emission.OFF:
            ui.html(wording.emission(state), sanitize=False)
        if state.log:
            ui.label(f"The view before: {state.log[-1].text}").classes("before")
    with ui.element("div").classes("form"):
        station = ui.input("Station file", placeholder="empty: the simulated bench").classes("station")
        ports = ui.input("Ports", value="2-5").classes("ports")
        attended = ui.checkbox("somebody stands at the laser's key switch (--attended)")
        with ui.element("div").classes("arm"):
            armed = ui.switch("light may be switched on (--arm)").classes("armed")
            button = ui.button("Start", color=None).classes("start")
        message = ui.label().classes("message")

    async def start() -> None:
        bench = (station.value or "").strip()
        named = [f"--station={bench}"] if bench else []
        light = allowed(armed=bool(armed.value), attended=bool(attended.value))
        words = [
            "live",
            *named,
            f"--ports={ports.value or ''}",
            f"--runs={watching.folder}",
            f"--unwatched={UNWATCHED}",
            *light,
        ]
        before = views_in(watching.folder)

        def leads_to() -> str:
            view = view_going_on(watching.folder)
            return "/live" if view is not None and view.directory not in before else ""

        armed.set_value(False)
        await begin(words, watching, message, leads_to, bench)

    button.on_click(start)
