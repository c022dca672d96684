"""A live view: the channels of a bench measured again and again, without a protocol and without a run.

What it sees is put where the dashboard looks, and what it is asked for is found there: `labctl.runs.live.sight`.
"""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from instruments.bench import Observer, Observers
from instruments.errors import OutOfRange, SettingChanged
from instruments.units import quantity
from instruments.values import Codes
from labctl.analysis.course import Course, begun
from labctl.bench.laser_limits import check_laser
from labctl.bench.opening import Access
from labctl.bench.signals import Interruption
from labctl.bench.station import Station
from labctl.engine.audience import Audience
from labctl.engine.control import Control, controlled
from labctl.engine.hands import Hands, Traces, in_hands
from labctl.engine.start import carried_out
from labctl.errors import StationError, writing
from labctl.runs.format.layout import RunPaths
from labctl.runs.format.origin import Origin
from labctl.runs.live.alarm import may_emit
from labctl.runs.live.logs import EventLog
from labctl.runs.live.owner import owned, writer_of
from labctl.runs.live.sight import LIVE, RECENT, SIGHT, Sight, Wishes, wishes_in, write_sight

TASK = "labctl live"
COMPARED_EVERY = 50
"""Looks after which settings and powers are compared; with the drive off, after so many times `IDLE_S`."""
WIDENED_AFTER = 3
"""Looks one after the other that touch the end of a range before the vertical ranges are found anew."""
IDLE_S = 0.1
PICTURE = np.ones((32, 32))
"""All mirrors towards the chip: the most light there is."""


@dataclass(frozen=True)
class View:
    """What is looked at: `ports` at once, each look a trace of `window_s`, `rate_hz` looks a second at most.

    folder: that of the runs, in which the view is found. duration_s: after which it ends; None: when somebody ends it.
    unwatched_s: for so long no page of a dashboard shows it, and it ends; None: it may be looked at elsewhere.
    wavelength_nm: of the first light.
    """

    station: Station
    folder: Path
    ports: tuple[int, ...]
    wavelength_nm: float
    access: Access = Access()
    window_s: float = 2e-9
    averages: int = 1
    rate_hz: float = 10.0
    duration_s: float | None = None
    unwatched_s: float | None = None
    drive_seed: int = 1


@dataclass(frozen=True)
class Viewed:
    """How a live view went: its folder, what it saw last (None: nothing), for how long, s, and if it was left alone."""

    directory: Path
    last: Sight | None
    seconds: float
    unwatched: bool


Show = Callable[[Sight | None], object]
"""Called at every look; with None when the bench is dark or the drive is off, once."""


def watch(view: View, interruption: Interruption, show: Show, observer: Observer | None = None) -> Viewed:
    """Open the bench, light it, and look until the end; it is dark then, however that comes.

    Raises:
        StationError, OutOfRange: the station is wrong; no light was switched on.
        NotConfigured: the laser is not armed.
        BenchInUse: another process has an instrument.
        InstrumentError: an instrument failed; the bench is in the safe state.
        NotWritten: the disk is full or refuses; the bench is in the safe state.
    """
    check_laser(view.station, [view.wavelength_nm])
    directory = view.folder / LIVE / f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{os.getpid()}"
    with ExitStack() as stack:
        events = stack.enter_context(EventLog())

        def make(origin: Origin) -> Path:
            forget_ended(view.folder)
            with writing(directory, "name another --runs"):
                directory.mkdir(parents=True)
                stack.enter_context(owned(directory))
            events.event(
                "live started",
                ports=list(view.ports),
                unwatched_s=view.unwatched_s,
                origin=str(origin),
                **carried_out(view.station),
            )
            return directory

        hands = stack.enter_context(
            in_hands(
                view.station,
                view.access,
                wavelength_nm=view.wavelength_nm,
                drive_seed=view.drive_seed,
                observer=Observers(events, observer or Observer()),
                task=TASK,
                directory=make,
            )
        )
        control = stack.enter_context(controlled(directory, interruption))
        hands.show(PICTURE)
        audience = Audience(directory, view.unwatched_s)
        looking = _Looking(view, hands, control, audience, directory, show, Observers(events, observer or Observer()))
        began = time.monotonic()
        looking.until(None if view.duration_s is None else began + view.duration_s)
        hands.dark()
        why = {"text": f"nobody has looked for {view.unwatched_s:g} s"} if looking.left else {}
        events.event("stopped", at_once=False, **why)
        return Viewed(directory, looking.last, time.monotonic() - began, looking.left)


def forget_ended(folder: Path) -> None:
    """Remove what live views that ended dark have left in `folder`."""
    for directory in sorted((folder / LIVE).glob("*")):
        if directory.is_dir() and not may_emit(directory) and writer_of(RunPaths(directory)) is None:
            shutil.rmtree(directory, ignore_errors=True)


@dataclass
class _Looking:
    """A view under way."""

    view: View
    hands: Hands
    control: Control
    audience: Audience
    directory: Path
    show: Show
    observer: Observer
    last: Sight | None = None
    left: bool = False
    _wishes: Wishes = field(default_factory=Wishes)
    _recent: list[Codes] = field(default_factory=list)
    _course: Course | None = None
    _began: float = 0.0
    _looks: int = 0
    _clipped: int = 0

    def until(self, end: float | None) -> None:
        """Look until the end, or until somebody wants it, or nobody looks any more."""
        due = self._began = time.monotonic()
        turns, looking_s = 0, 0.0
        while not self._over(end):
            begun_at = time.monotonic()
            if self.control.paused:
                self._rest(end)
                continue
            self._heed(wishes_in(self.directory))
            turns += 1
            if turns % COMPARED_EVERY == 0:
                self._compare()
            if not self.hands.drive:
                self.hands.require_supervision()
                self.control.interruption.wait(IDLE_S)
                continue
            traces = self.hands.capture(window=self.view.window_s, ports=self.view.ports, averages=self.view.averages)
            self._see(traces, (self._looks + 1) / max(looking_s + time.monotonic() - begun_at, 1e-9))
            due = max(due + 1 / self.view.rate_hz, time.monotonic())
            while (left := due - time.monotonic()) > 0 and not self._over(end):
                self.control.interruption.wait(min(left, IDLE_S))
            looking_s += time.monotonic() - begun_at

    def _over(self, end: float | None) -> bool:
        self.left = self.audience.has_left
        return self.left or self.control.stopped or (end is not None and time.monotonic() >= end)

    def _rest(self, end: float | None) -> None:
        self.hands.dark()
        self.observer.event("paused")
        self.show(None)
        while self.control.paused and not self._over(end):
            self.control.interruption.wait(IDLE_S)
        if not self._over(end):
            self.observer.event("going on")

    def _heed(self, wishes: Wishes) -> None:
        """Set what is asked for now and was not before; what is refused changes nothing and is said."""
        if wishes == self._wishes:
            return
        before, self._wishes = self._wishes, wishes
        if wishes.power and wishes.power != before.power:
            with self._saying_refusals():
                self.hands.laser.power = wishes.power
                self._forget()
        if wishes.wavelength and wishes.wavelength != before.wavelength:
            with self._saying_refusals():
                check_laser(self.view.station, [quantity(wishes.wavelength, "nm")])
                self.hands.laser.wavelength = wishes.wavelength
                self._forget()
        if wishes.drive != self.hands.drive:
            self.hands.drive = wishes.drive
            if not wishes.drive:
                self.show(None)
        if wishes.anew != before.anew:
            self.hands.find_ranges()
            self._forget()

    @contextmanager
    def _saying_refusals(self) -> Iterator[None]:
        try:
            yield
        except (OutOfRange, StationError, ValueError) as error:
            self.observer.warning(f"not set: {error}")

    def _forget(self) -> None:
        """The light is another one: what was seen before says nothing of it."""
        self._recent, self._course = [], None

    def _see(self, traces: Traces, rate_hz: float) -> None:
        scale_v = np.array([one.scale_v for one in traces.scalings])
        if self.last is not None and not np.array_equal(self.last.scale_v, scale_v):
            self._recent = []
        now = time.monotonic()
        if self._course is None:
            self._began, self._course = now, begun(traces.volts)
        self._looks += 1
        self._recent = [*self._recent, traces.codes][-RECENT:]
        self._course = self._course.with_more(now - self._began, traces.volts)
        self.last = Sight(
            traces.ports,
            float(traces.time_s[1] - traces.time_s[0]) if traces.time_s.size > 1 else self.view.window_s,
            scale_v,
            np.array([one.offset_v for one in traces.scalings]),
            np.stack(self._recent).astype(traces.codes.dtype, copy=False),
            self._course.elapsed_s,
            self._course.level_v,
            self._course.likeness,
            self._course.peak_v,
            self._looks,
            rate_hz,
        )
        with writing(self.directory / SIGHT, "name another --runs"):
            write_sight(self.directory, self.last)
        self.show(self.last)
        self._clipped = self._clipped + 1 if traces.clipped.any() else 0
        if self._clipped == WIDENED_AFTER:
            self._clipped = 0
            self.observer.warning("a trace touched the end of its range: the vertical ranges are found anew")
            self.hands.find_ranges()

    def _compare(self) -> None:
        try:
            self.hands.require_unchanged()
        except SettingChanged as change:
            self.observer.warning(f"{change}; the vertical ranges are found anew")
