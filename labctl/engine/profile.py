"""Where the time of a shot goes: upload, DMD, arm, trigger, physics, transfer, storage."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from instruments.bench import Observer

STORAGE_BESIDE = "storage_beside_the_next_burst"
STEPS = ("upload", "dmd", "arm", "trigger", "physics", "transfer", "storage", STORAGE_BESIDE)


class Profile(Observer):
    """Adds up the wall time of each step.

    `upload` is the waveform into the AWG and all pictures of a burst into the DMD, drawing them included. `physics` is
    what a simulated bench computes during the other steps, most of it while the oscilloscope waits for its trigger; the
    rest of that wait is `trigger`, or in a burst part of `transfer`. A step that another thread takes beside the
    measurement is no part of the run's time, and the world computes for other steps meanwhile.
    """

    def __init__(self, physics_seconds: Callable[[], float]) -> None:
        """`physics_seconds` says how long the simulated world has computed so far; 0 for a real bench."""
        self.seconds: dict[str, float] = defaultdict(float)
        self._physics_seconds = physics_seconds

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add the duration of the block to `name`, less what the simulated world computed meanwhile."""
        started, computed = perf_counter(), self._physics_seconds()
        try:
            yield
        finally:
            physics = 0.0 if name == STORAGE_BESIDE else self._physics_seconds() - computed
            self.seconds[name] += perf_counter() - started - physics
            self.seconds["physics"] += physics

    def budget(self, shots: int) -> dict[str, float]:
        """Milliseconds per shot of each step that was taken."""
        taken = [step for step in STEPS if step in self.seconds]
        return {step: round(1e3 * self.seconds[step] / max(shots, 1), 4) for step in taken}
