"""How long the demonstration takes, and the paper's experiments with few benches, from the command to its end.

    python -m benchmarks reproduction

Needs the data sets of the experiments, and torch. The demonstration is the median of several; the experiments are
carried out once, which takes minutes.
"""

import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.commands import labctl
from benchmarks.rows import Goal, Row

REPETITIONS = 3
DEMO = Goal(most=20.0, of="figure")
QUICK = Goal(most=90.0, of="figure")


def rows() -> Iterator[Row]:
    """A row for each command."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        demos = [labctl("demo", "--out", str(folder / str(number))) for number in range(REPETITIONS)]
        quick = labctl("reproduce", "all", "--quick", "--out", str(folder / "quick"))
    demo = sorted(demos, key=lambda taken: taken.wall_s)[REPETITIONS // 2]
    yield Row("labctl demo", demo.wall_s, "s", demo.processor_s, goal=DEMO)
    yield Row("labctl reproduce all --quick", quick.wall_s, "s", quick.processor_s, goal=QUICK)
