from io import BytesIO

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from PIL import Image

from labctl.reports.canvas import PURPLE
from labctl.reports.figures.signals import signals_png
from labctl.runs.format.origin import Origin
from labctl.runs.live.sight import Sight

SEEN = Sight(
    ports=(2, 3),
    sample_interval_s=40e-12,
    scale_v=np.full(2, 1e-3),
    offset_v=np.zeros(2),
    recent=np.random.default_rng(1).integers(-90, 90, (5, 2, 50)).astype(np.int8),
    elapsed_s=np.zeros(1),
    level_v=np.zeros((1, 2)),
    likeness=np.ones((1, 2)),
    peak_v=np.array([0.05, 0.02]),
    looks=5,
    rate_hz=9.9,
)


@pytest.mark.parametrize(("origin", "marked"), [(Origin.SIMULATED, True), (Origin.MIXED, True), (Origin.REAL, False)])
def test_a_picture_for_the_notes_is_marked_like_every_figure(origin: Origin, marked: bool) -> None:
    with Image.open(BytesIO(signals_png(SEEN, "fibre 3", origin))) as picture:
        found = np.asarray(picture.convert("RGB"))
    purple = np.round(255 * np.array(to_rgb(PURPLE)))
    assert (np.abs(found - purple) <= 1).all(axis=2).any() == marked
