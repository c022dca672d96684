"""Where the time of a shot goes: upload, DMD, arm, trigger, physics, transfer, comparison, storage."""

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from instruments.bench import Observer

STORAGE_BESIDE = "storage_beside_the_next_burst"
STEPS = ("upload", "dmd", "arm", "trigger", "physics", "transfer", "comparison", "storage", STORAGE_BESIDE)


class Profile(Observer):
    """Adds up the wall time of each step.

    `upload` is the waveform into the AWG and all pictures of a burst into the DMD, drawing them included. `physics` is
    what a simulated bench computes during the other steps, most of it while the oscilloscope waits for its trigger; the
    rest of that wait is `trigger`, or in a burst part of `transfer`. `comparison` is how long it takes to find out that
    settings and records are what they should be, which is no part of the `storage` that waits for it. A step that
    another thread takes beside the
    measurement is no part of the run's time, and the world computes for other steps meanwhile.
    """

    def __init__(self, physics_seconds: Callable[[], float]) -> None:
        """`physics_seconds` says how long the simulated world has computed so far; 0 for a real bench."""
        self.seconds: dict[str, float] = defaultdict(float)
        self._physics_seconds = physics_seconds
        self._inside = 0.0  # seconds of the steps inside the one that is being taken

    @contextmanager
    def step(self, name: str) -> Iterator[None]:
        """Add the duration of the block to `name`, less what the simulated world computed meanwhile."""
        if name == STORAGE_BESIDE:  # in a thread of its own
            started = perf_counter()
            yield
            self.seconds[name] += perf_counter() - started
            return
        outside, self._inside = self._inside, 0.0
        started, computed = perf_counter(), self._physics_seconds()
        try:
            yield
        finally:
            elapsed, physics = perf_counter() - started, self._physics_seconds() - computed
            self.seconds[name] += elapsed - physics - self._inside
            self.seconds["physics"] += physics
            self._inside = outside + elapsed

    def budget(self, shots: int) -> dict[str, float]:
        """Milliseconds per shot of each step that was taken."""
        taken = [step for step in STEPS if step in self.seconds]
        return {step: round(1e3 * self.seconds[step] / max(shots, 1), 4) for step in taken}
