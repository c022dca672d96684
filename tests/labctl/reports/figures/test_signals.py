"""The picture of a look at the channels."""

from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageColor

from labctl.reports.canvas import PURPLE
from labctl.reports.figures.signals import signals_png
from labctl.runs.format.origin import Origin
from labctl.runs.live.sight import Sight

LOOKS, PORTS, SAMPLES = 4, 2, 50


def sight() -> Sight:
    codes = np.random.default_rng(1).integers(-100, 100, (LOOKS, PORTS, SAMPLES)).astype(np.int8)
    levels = np.full((1, PORTS), 0.1)
    ends = np.full(PORTS, 1e-3), np.zeros(PORTS)
    return Sight((2, 3), 40e-12, *ends, codes, np.zeros(1), levels, np.ones((1, PORTS)), levels[0], LOOKS, 10.0)


@pytest.mark.parametrize("origin", Origin)
def test_what_is_simulated_is_marked(origin: Origin, tmp_path: Path) -> None:
    with Image.open(BytesIO(signals_png(sight(), "a look", origin))) as picture:
        colours = {colour for _, colour in picture.convert("RGB").getcolors(1 << 20) or ()}
        picture.save(tmp_path / "signals.png")
    assert (ImageColor.getrgb(PURPLE) in colours) == (origin is not Origin.BENCH)
