"""One row of the table of what labctl claims about speed: a figure, its reference of the same run, and the goal."""

import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Literal, NamedTuple

REPETITIONS = 5


@dataclass(frozen=True)
class Goal:
    """What is asked for.

    Attributes:
        least, most: The bounds; at most one of the two.
        of: Whether the figure itself is bounded, or its ratio to the reference.
    """

    least: float | None = None
    most: float | None = None
    of: Literal["figure", "ratio"] = "ratio"

    def __str__(self) -> str:
        """As a cell of the table."""
        word, bound = ("at least", self.least) if self.least is not None else ("at most", self.most)
        return f"{'ratio ' if self.of == 'ratio' else ''}{word} {bound:g}"

    def reached(self, value: float) -> bool:
        """Whether a value lies within the bounds."""
        return (self.least is None or value >= self.least) and (self.most is None or value <= self.most)


@dataclass(frozen=True)
class Row:
    """A figure beside its reference.

    Attributes:
        what: What was measured, in words.
        figure: The median.
        unit: Of figure, processor and reference.
        processor: The figure by time of the processor instead of the clock, where it is one of time.
        against: What the reference is, in words; empty: there is none.
        reference: Its median, from the same run.
        goal: What is asked for.
    """

    what: str
    figure: float
    unit: str
    processor: float | None = None
    against: str = ""
    reference: float | None = None
    goal: Goal | None = None

    @property
    def ratio(self) -> float | None:
        """The figure over its reference."""
        return self.figure / self.reference if self.reference else None

    @property
    def reached(self) -> bool | None:
        """Whether the goal is reached; None where there is no goal."""
        if self.goal is None:
            return None
        value = self.figure if self.goal.of == "figure" else self.ratio
        return value is not None and self.goal.reached(value)

    def as_json(self) -> dict[str, object]:
        """All of it, ratio and verdict included."""
        return {**asdict(self), "ratio": self.ratio, "reached": self.reached}


class Timing(NamedTuple):
    """How long something took (s): by the clock, and of this process's time of the processor."""

    wall_s: float
    processor_s: float


def timed(action: Callable[[], object]) -> Timing:
    """Do something once."""
    wall, processor = time.perf_counter(), time.process_time()
    action()
    return Timing(time.perf_counter() - wall, time.process_time() - processor)


def interleaved(
    *actions: Callable[[], object],
    repetitions: int = REPETITIONS,
    measure: Callable[[Callable[[], object]], Timing] = timed,
) -> list[Timing]:
    """The median of each of `actions`, taken in turns so that what else the machine does meets all of them alike.

    A first turn warms up and does not count.
    """
    turns: Sequence[list[Timing]] = [[measure(action) for action in actions] for _ in range(repetitions + 1)][1:]
    return [
        Timing(*(statistics.median(values) for values in zip(*one, strict=True))) for one in zip(*turns, strict=True)
    ]
