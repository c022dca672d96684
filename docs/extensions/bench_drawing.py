"""The directive `bench-drawing`: what light passes through, and what labctl is beside it, as one SVG.

It takes its colours from the page, light or dark.
"""

from html import escape

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

WIDTH, HEIGHT = 840, 302
BOX = (104, 46)
WAY = ("laser light", "phase modulator", "multimode fibre", "mirrors (DMD)", "reservoir chip", "detectors")
INSTRUMENTS = {"laser": 0, "AWG": 1, "DMD": 3, "patch panel": 4, "oscilloscope": 5}
SOFTWARE = ("drivers", "protocol and engine", "run on disk", "readout", "report, dashboard")
SAYS = (
    "Light goes from the laser through a phase modulator, a multimode fibre, a micromirror device and a reservoir chip "
    "to the detectors. Laser, AWG, DMD, patch panel and oscilloscope speak with labctl over the wire, or the simulated "
    "bench speaks in their place. labctl goes from drivers over protocol and engine to the run on disk, readout and "
    "report."
)


class BenchDrawing(SphinxDirective):
    """The drawing of the landing page."""

    def run(self) -> list[nodes.Node]:
        """The SVG in the page itself: so it has the page's colours."""
        return [nodes.raw("", drawing(), format="html")]


def drawing() -> str:
    """Bench above, wire between, labctl below."""
    parts = [_row(WAY, 40, "light")]
    parts += [_line(_middle(place), 86, _middle(place), 118, dashed=True) for place in INSTRUMENTS.values()]
    parts += [_box(name, _middle(place), 118, round_=14) for name, place in INSTRUMENTS.items()]
    parts += [_line(_middle(place), 164, _middle(place), 196) for place in INSTRUMENTS.values()]
    parts.append(_line(20, 196, WIDTH - 20, 196, heavy=True))
    parts.append(
        _text(WIDTH / 2, 213, "the wire: VISA, sockets, USB. The simulated bench answers here in the same bytes")
    )
    parts.append(_line(_middle(0), 196, _middle(0), 248, arrow=True))
    parts.append(_row(SOFTWARE, 248, "labctl"))
    return (
        f'<svg class="bench-drawing" role="img" viewBox="0 0 {WIDTH} {HEIGHT}" width="100%" fill="none" '
        'stroke="currentColor" font-family="sans-serif" font-size="12.5">'
        f"<title>The bench and labctl</title><desc>{escape(SAYS)}</desc>"
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0 0 8 4 0 8z" fill="currentColor" stroke="none"/></marker></defs>' + "".join(parts) + "</svg>"
    )


def _row(names: tuple[str, ...], top: float, title: str) -> str:
    """Boxes beside each other with arrows between them, and what they are above the first."""
    middle = top + BOX[1] / 2
    arrows = (
        _line(_middle(place) + BOX[0] / 2, middle, _middle(place + 1) - BOX[0] / 2 - 2, middle, arrow=True)
        for place in range(len(names) - 1)
    )
    heading = _text(_middle(0) - BOX[0] / 2, top - 10, title, anchor="start", weight="bold")
    return heading + "".join(_box(name, _middle(place), top) for place, name in enumerate(names)) + "".join(arrows)


def _middle(place: int) -> float:
    return 70 + 140 * place


def _box(name: str, middle: float, top: float, round_: int = 3) -> str:
    left = middle - BOX[0] / 2
    frame = f'<rect x="{left}" y="{top}" width="{BOX[0]}" height="{BOX[1]}" rx="{round_}"/>'
    words = name.split(" ")
    lines = [name] if len(name) < 15 else [" ".join(words[:-1]), words[-1]]
    first = top + BOX[1] / 2 + 4.5 - 8 * (len(lines) - 1)
    return frame + "".join(_text(middle, first + 16 * number, line) for number, line in enumerate(lines))


def _line(
    x1: float, y1: float, x2: float, y2: float, *, arrow: bool = False, dashed: bool = False, heavy: bool = False
) -> str:
    extra = ' marker-end="url(#tip)"' * arrow + ' stroke-dasharray="3 3"' * dashed + ' stroke-width="2.5"' * heavy
    return f'<line x1="{x1}" y1="{y1}" x2="{x2}" y2="{y2}"{extra}/>'


def _text(x: float, y: float, text: str, *, anchor: str = "middle", weight: str = "normal") -> str:
    look = f'text-anchor="{anchor}" font-weight="{weight}" fill="currentColor" stroke="none"'
    return f'<text x="{x}" y="{y}" {look}>{escape(text)}</text>'


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.add_directive("bench-drawing", BenchDrawing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
