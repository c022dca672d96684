"""`labctl live` on a terminal: every number whole, the bars as long as there is room."""

from io import StringIO

import numpy as np
import pytest
from rich.console import Console

from labctl.commands.live import BAR, _bars
from labctl.runs.live.sight import Sight
from tests.labctl.commands.conftest import Typed


def sight(level_v: float) -> Sight:
    """As high as the oscilloscope's range, on two ports."""
    codes = np.tile(np.array([127, 126], np.int8), (4, 2, 25))
    return Sight(
        (2, 10),
        4e-11,
        np.full(2, level_v / 255),
        np.full(2, level_v - 127 * level_v / 255),
        codes,
        np.zeros(1),
        np.full((1, 2), level_v),
        np.ones((1, 2)),
        np.full(2, level_v),
        1000,
        10.0,
    )


@pytest.mark.parametrize("columns", [70, 80, 100, 200])
def test_the_numbers_are_whole_and_the_bars_take_the_rest(columns: int) -> None:
    file = StringIO()
    Console(file=file, width=columns).print(_bars(sight(0.2), columns))
    first, second = (line for line in file.getvalue().splitlines() if "CLIPPED" in line)
    assert first.split()[:3] == ["2", "199.61", "mV"]
    assert second.split()[0] == "10"
    assert "…" not in file.getvalue()
    bars = first.count("█")
    assert 0 < bars <= BAR
    assert columns < 200 or bars > 30


@pytest.mark.parametrize("option", ["--for", "--unwatched"])
def test_a_time_that_is_none_is_refused(option: str, typed: Typed) -> None:
    status, _, told = typed("live", option, "-1s")
    assert status == 2
    assert f"{option} -1s: is no time to look" in told
