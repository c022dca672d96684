"""What all pages have in common: the head with the way to the others, headings, and parts that are drawn anew."""

from collections.abc import Callable, Iterable
from pathlib import Path

from nicegui import ui

from labctl.dashboard import wording
from labctl.dashboard.monitor import Alarm, Watching
from labctl.dashboard.sketches import escape
from labctl.printable import printable
from labctl.runs.format.origin import Origin
from labctl.runs.format.store import is_elsewhere

REFRESH_S = 0.4
PAGES = {"/": "Runs", "/start": "Start a run", "/live": "Live", "/queue": "Queue", "/sweeps": "Sweeps"}
"""What the head leads to."""
STYLE = (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
REMEMBERED = """<script>
document.documentElement.style.colorScheme = localStorage.getItem("labctl-scheme") || "light dark";
</script>"""
NOT_REAL = {
    Origin.SIMULATED: "SIMULATED BENCH: no instrument, no light",
    Origin.MIXED: "MIXED BENCH: some instruments are simulated, the others are real",
    Origin.REPLAYED: "RECORDING: no instrument, no light",
}


class Region:
    """A part of a page that is drawn anew where its content has changed."""

    def __init__(self, name: str, content: Callable[[], str]) -> None:
        """Show what `content` says, which is HTML of this program's own making."""
        self._content = content
        self._element = ui.html(content(), sanitize=False).classes(f"{name}-region")

    def refresh(self) -> None:
        """Draw it anew if it says something else now."""
        content = self._content()
        if content != self._element.content:
            self._element.set_content(content)


def refresh(regions: Iterable[Region]) -> None:
    """Draw anew what has changed."""
    for region in regions:
        region.refresh()


class Alarms:
    """A banner for every laser that did not go dark, which leads to its page; on that page it would be there twice."""

    def __init__(self, watching: Watching, own: str) -> None:
        """On the page with the address `own`."""
        self._watching = watching
        self._own = own
        self._drawn: list[Alarm] = []
        self._element = ui.element("div").classes("alarms")
        self.refresh()

    def refresh(self) -> None:
        """Draw them anew if there are others."""
        found = [alarm for alarm in self._watching.alarms() if alarm.address != self._own]
        if found == self._drawn:
            return
        self._drawn = found
        self._element.clear()
        with self._element:
            for alarm in found:
                with ui.link(target=f"/{alarm.address}").props("role=alert"):
                    ui.html(wording.alarm(alarm), sanitize=False)


def frame(watching: Watching, title: str, *origins: Origin | None, own: str = "") -> None:
    """The head of a page; that of one about instruments that are not all real says so, and looks so.

    origins: of the runs or the live view that it shows; None where that is not known.
    own: its address, where it is that of one run or live view.
    """
    ui.page_title(printable(title))
    ui.add_head_html(f"{REMEMBERED}<style>{STYLE}</style>")
    with ui.element("header"):
        ui.link("labctl", "/").classes("home")
        ui.html(f"<h1>{escape(title)}</h1>", sanitize=False)
        with ui.element("nav"):
            for address, name in PAGES.items():
                ui.link(name, address)
        ui.button("Colours", on_click=_next_colours, color=None).classes("colours").props("flat")
    if not is_elsewhere(watching.folder):
        ui.timer(REFRESH_S, Alarms(watching, own).refresh)
    origin = Origin.together(filter(None, origins))
    if origin in NOT_REAL:
        ui.query("body").classes(origin)
        ui.html(escape(NOT_REAL[origin]), sanitize=False).classes(f"not-real {origin}")


def heading(text: str) -> None:
    """Of a section."""
    ui.html(f"<h2>{escape(text)}</h2>", sanitize=False)


def _next_colours() -> None:
    """As the system has them, dark, light, and round again; remembered by the browser."""
    ui.run_javascript(
        "const schemes = ['light dark', 'dark', 'light'], style = document.documentElement.style;"
        "style.colorScheme = schemes[(schemes.indexOf(style.colorScheme) + 1) % 3];"
        "localStorage.setItem('labctl-scheme', style.colorScheme)"
    )


def say_elsewhere(folder: Path, what: str) -> None:
    """In place of what can only be done where the runs are."""
    ui.html(f'<p class="nothing elsewhere">{escape(f"{folder} is elsewhere: {what}")}</p>', sanitize=False)


def show_elsewhere(watching: Watching, title: str) -> None:
    """In place of a page that makes runs, of a folder in which none can be made."""
    frame(watching, title)
    with ui.element("main"), ui.element("section").classes("wide"):
        say_elsewhere(watching.folder, "it is only read; open a dashboard on the machine that measures")


def show_unread(watching: Watching, problem: str) -> None:
    """In place of a page of what cannot be read now."""
    frame(watching, f"Runs in {watching.folder}")
    with ui.element("main"), ui.element("section").classes("wide"):
        ui.html(f'<p class="problem">{escape(problem)}</p>', sanitize=False)


def show_missing(watching: Watching, name: str) -> None:
    """There is no such run."""
    frame(watching, "No such run")
    with ui.element("main"):
        ui.label(printable(f"{watching.folder} has no run {name}."))
        ui.link("All runs", "/")
