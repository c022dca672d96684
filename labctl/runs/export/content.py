"""What is exported of a run: its variables for some shots, in blocks that fit in memory whatever the run's size."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from labctl.errors import RunError
from labctl.printable import printable
from labctl.runs.read.run import Run
from labctl.runs.read.variables import Variable, variables_of

Representation = Literal["volts", "codes"]
TRACE = ("shot", "port", "time")
BLOCK_BYTES = 1 << 22
"""Of a variable, in memory at a time."""

Progress = Callable[[int, int], None]
"""Called with how many shots are written, and of how many."""


@dataclass(frozen=True)
class Content:
    """What one exported file holds.

    Attributes:
        variables: the arrays; those with the dimension `shot` are read from `shots` only.
        shots: places of the first shot and after the last one in the run.
        attributes: text and numbers that describe the whole, the manifest among them.
        progress: called after every block of traces.
    """

    variables: tuple[Variable, ...]
    shots: range
    attributes: dict[str, str | int]
    progress: Progress

    @classmethod
    def of(
        cls, run: Run, shots: tuple[int, int] | None, kept: Representation, progress: Progress = lambda *_: None
    ) -> "Content":
        """The shots of the plan from the first to the last of `shots`, None for all, as `kept`.

        Raises:
            RunError: there are none, or the run is damaged.
        """
        index = run.planned["index"]
        first, last = (0, run.shape.shots) if shots is None else shots
        places = range(int(np.searchsorted(index, first)), int(np.searchsorted(index, last, side="right")))
        if not places:
            there = f"it has shots {index[0]} to {index[-1]}" if index.size else "no shot of it is complete yet"
            raise RunError(f"{run.path}: there is nothing to export: {there}")
        left_out = "frames" if kept == "volts" else "volts"
        return cls(
            tuple(one for one in variables_of(run) if one.name != left_out),
            places,
            {
                "title": f"run {printable(run.path.resolve().name)} of labctl",
                "format_version": str(run.manifest["format_version"]),
                "manifest": json.dumps(run.manifest),
                "complete": int(run.complete),
                "shots_planned": run.shape.shots,
                "suspect_left_out": run.suspect,
            },
            progress,
        )

    @property
    def sizes(self) -> dict[str, int]:
        """Length of each dimension."""
        return {name: size for one in self.variables for name, size in zip(one.dims, self.shape(one), strict=True)}

    @property
    def size(self) -> int:
        """Bytes of all arrays."""
        return sum(int(np.prod(self.shape(one))) * one.dtype.itemsize for one in self.variables)

    def shape(self, variable: Variable) -> tuple[int, ...]:
        """The size of what is exported of a variable."""
        return (len(self.shots), *variable.shape[1:]) if "shot" in variable.dims else variable.shape

    def rows(self, variable: Variable) -> int:
        """Shots of a block of a variable."""
        row = int(np.prod(variable.shape[1:])) * variable.dtype.itemsize
        return max(1, min(len(self.shots), BLOCK_BYTES // max(1, row)))

    def blocks(self, variable: Variable) -> Iterator[tuple[int, NDArray[Any]]]:
        """The values of a variable, piece by piece: where the piece begins in what is exported, and the piece.

        Raises:
            RunError: the run is damaged.
        """
        rest = (slice(None),) * (len(variable.shape) - 1)
        if "shot" not in variable.dims:
            yield 0, variable.read((slice(None), *rest))
            return
        step = self.rows(variable)
        for start in range(0, len(self.shots), step):
            piece = self.shots[start : start + step]
            yield start, np.ascontiguousarray(variable.read((slice(piece.start, piece.stop), *rest)))
            if variable.dims == TRACE:
                self.progress(start + len(piece), len(self.shots))
