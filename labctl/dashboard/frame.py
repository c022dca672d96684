"""What all pages have in common: the head with the way to the others, headings, and parts that are drawn anew."""

from collections.abc import Callable, Iterable
from pathlib import Path

from nicegui import ui

from labctl.dashboard.sketches import escape
from labctl.runs.format.origin import Origin

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


def frame(title: str, *origins: Origin | None) -> None:
    """The head of a page; that of one about instruments that are not all real says so, and looks so.

    origins: of the runs or the live view that it shows; None where that is not known.
    """
    ui.page_title(title)
    ui.add_head_html(f"{REMEMBERED}<style>{STYLE}</style>")
    with ui.element("header"):
        ui.link("labctl", "/").classes("home")
        ui.html(f"<h1>{escape(title)}</h1>", sanitize=False)
        with ui.element("nav"):
            for address, name in PAGES.items():
                ui.link(name, address)
        ui.button("Colours", on_click=_next_colours, color=None).classes("colours").props("flat")
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


def show_elsewhere(title: str, folder: Path) -> None:
    """In place of a page that makes runs, of a folder in which none can be made."""
    frame(title)
    with ui.element("main"), ui.element("section").classes("wide"):
        say_elsewhere(folder, "it is only read; open a dashboard on the machine that measures")


def show_unread(folder: Path, problem: str) -> None:
    """In place of a page of what cannot be read now."""
    frame(f"Runs in {folder}")
    with ui.element("main"), ui.element("section").classes("wide"):
        ui.html(f'<p class="problem">{escape(problem)}</p>', sanitize=False)


def show_missing(folder: Path, name: str) -> None:
    """There is no such run."""
    frame("No such run")
    with ui.element("main"):
        ui.label(f"{folder} has no run {name}.")
        ui.link("All runs", "/")
