"""Where the time of a shot goes: DMD, arm, trigger, physics, transfer, storage."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any

from instruments.bench import Bench

STEPS = ("dmd", "arm", "trigger", "physics", "transfer", "storage")


class Stopwatch:
    """Adds up the wall time of each step.

    `physics` is what a simulated bench computes while the oscilloscope waits for its trigger; the rest of that wait is
    `trigger`.
    """

    def __init__(self, physics_seconds: Callable[[], float]) -> None:
        """`physics_seconds` tells how long the simulated world has computed so far; 0 for a real bench."""
        self.seconds: dict[str, float] = defaultdict(float)
        self._physics_seconds = physics_seconds

    def watch(self, bench: Bench) -> None:
        """Time the calls a shot makes on the instruments of `bench`."""
        for instrument, method, step in (
            (bench.dmd, "show", "dmd"),
            (bench.scope, "arm", "arm"),
            (bench.scope, "wait", "trigger"),
            (bench.scope, "read", "transfer"),
        ):
            setattr(instrument, method, self._timed(getattr(instrument, method), step))

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add the duration of the block to `name`, less what the simulated world computed meanwhile."""
        started, computed = time.perf_counter(), self._physics_seconds()
        try:
            yield
        finally:
            physics = self._physics_seconds() - computed
            self.seconds[name] += time.perf_counter() - started - physics
            self.seconds["physics"] += physics

    def budget(self, shots: int) -> dict[str, float]:
        """Milliseconds of each step per shot."""
        return {step: round(1e3 * self.seconds[step] / max(shots, 1), 4) for step in STEPS}

    def _timed(self, method: Callable[..., Any], step: str) -> Callable[..., Any]:
        @wraps(method)
        def timed(*arguments: Any, **named: Any) -> Any:
            with self.step(step):
                return method(*arguments, **named)

        return timed
