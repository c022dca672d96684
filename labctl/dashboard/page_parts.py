"""What the pages are made of: a frame, headings, and regions that are drawn anew where their content has changed."""

from collections.abc import Callable, Iterable
from pathlib import Path

from nicegui import ui

from labctl.dashboard.sketches import escape

STYLE = (Path(__file__).parent / "style.css").read_text(encoding="utf-8")
REMEMBERED = """<script>
document.documentElement.style.colorScheme = localStorage.getItem("labctl-scheme") || "light dark";
</script>"""


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
    """Draw anew those that say something else now."""
    for region in regions:
        region.refresh()


def frame(title: str) -> None:
    """What every page has: title, style, the way home and the colours."""
    ui.page_title(title)
    ui.add_head_html(f"{REMEMBERED}<style>{STYLE}</style>")
    with ui.element("header"):
        ui.link("labctl", "/").classes("home")
        ui.html(f"<h1>{escape(title)}</h1>", sanitize=False)
        ui.link("Live", "/live").classes("to-live")
        ui.button("Colours", on_click=_next_colours, color=None).classes("colours").props("flat")


def _next_colours() -> None:
    """As the system has them, dark, light, and round again; remembered by the browser."""
    ui.run_javascript(
        "const schemes = ['light dark', 'dark', 'light'], style = document.documentElement.style;"
        "style.colorScheme = schemes[(schemes.indexOf(style.colorScheme) + 1) % 3];"
        "localStorage.setItem('labctl-scheme', style.colorScheme)"
    )


def heading(text: str) -> None:
    """Of a section."""
    ui.html(f"<h2>{escape(text)}</h2>", sanitize=False)
