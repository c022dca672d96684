"""The style of all figures: colours, markers, line styles, fonts.

Colours are those of Okabe and Ito (Color Universal Design, 2008), which readers with colour-vision deficiencies can
tell apart. Curves differ in marker and line style as well, so that a figure still reads when printed in grey.
"""

from dataclasses import dataclass
from typing import Any

BLUE, VERMILLION, GREEN, ORANGE, SKY, PURPLE, BLACK = (
    "#0072B2",
    "#D55E00",
    "#009E73",
    "#E69F00",
    "#56B4E9",
    "#CC79A7",
    "#000000",
)
PALETTE = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, BLACK)
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (5, 1.5, 1, 1.5)),
    (0, (2, 1)),
    (0, (8, 2, 1, 2, 1, 2)),
    (0, (9, 2)),
    ":",
)
GREY = "#595959"
SHADE = "#E3E3E3"
STYLE: dict[Any, object] = {
    "axes.axisbelow": True,
    "axes.grid": False,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlesize": "medium",
    "figure.facecolor": "white",
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "grid.color": "#D9D9D9",
    "grid.linewidth": 0.6,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "path.simplify": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "labctl",
}


@dataclass(frozen=True)
class Look:
    """Colour, marker and line style of the n-th curve of a panel."""

    colour: str
    marker: str
    dashes: Any


def look(position: int) -> Look:
    """The look of the curve at `position`; repeats after seven."""
    turn = position % len(PALETTE)
    return Look(PALETTE[turn], MARKERS[turn], DASHES[turn])
