"""Where the time of a shot goes: upload, DMD, arm, trigger, physics, transfer, storage."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from time import perf_counter
from typing import Any

from instruments.bench import Bench

STORAGE_BESIDE = "storage_beside_the_next_burst"
STEPS = ("upload", "dmd", "arm", "trigger", "physics", "transfer", "storage", STORAGE_BESIDE)


class Stopwatch:
    """Adds up the wall time of each step.

    `upload` is the waveform into the AWG and all pictures of a burst into the DMD, drawing them included. `physics` is
    what a simulated bench computes during the other steps, most of it while the oscilloscope waits for its trigger; the
    rest of that wait is `trigger`, or in a burst part of `transfer`. A step that another thread takes beside the
    measurement is no part of the run's time.
    """

    def __init__(self, physics_seconds: Callable[[], float]) -> None:
        """`physics_seconds` tells how long the simulated world has computed so far; 0 for a real bench."""
        self.seconds: dict[str, float] = defaultdict(float)
        self._physics_seconds = physics_seconds

    def watch(self, bench: Bench) -> None:
        """Time the calls a shot makes on the instruments of `bench`."""
        for instrument, method, step in (
            (bench.awg, "load", "upload"),
            (bench.dmd, "load", "upload"),
            (bench.dmd, "show", "dmd"),
            (bench.dmd, "hold", "dmd"),
            (bench.dmd, "play", "dmd"),
            (bench.scope, "arm", "arm"),
            (bench.scope, "arm_burst", "arm"),
            (bench.scope, "wait", "trigger"),
            (bench.scope, "read", "transfer"),
            (bench.scope, "read_burst", "transfer"),
        ):
            if not hasattr(instrument, method):
                continue  # a DMD that shows one picture at a time
            setattr(instrument, method, self._timed(getattr(instrument, method), step))

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add the duration of the block to `name`, less what the simulated world computed meanwhile."""
        started, computed = perf_counter(), self._physics_seconds()
        try:
            yield
        finally:
            physics = self._physics_seconds() - computed
            self.seconds[name] += perf_counter() - started - physics
            self.seconds["physics"] += physics

    @contextmanager
    def beside(self, name: str) -> Iterator[None]:
        """Add the duration of the block, in a thread of its own, to `name`: the world computes for other steps."""
        started = perf_counter()
        try:
            yield
        finally:
            self.seconds[name] += perf_counter() - started

    def budget(self, shots: int) -> dict[str, float]:
        """Milliseconds per shot of each step that was taken."""
        taken = [step for step in STEPS if step in self.seconds]
        return {step: round(1e3 * self.seconds[step] / max(shots, 1), 4) for step in taken}

    def _timed(self, method: Callable[..., Any], step: str) -> Callable[..., Any]:
        @wraps(method)
        def timed(*arguments: Any, **named: Any) -> Any:
            with self.step(step):
                return method(*arguments, **named)

        return timed
