"""Signals."""

import itertools
import os
import signal
import sys
import threading
import weakref
from collections.abc import Callable, Iterator, Sequence
from types import FrameType
from typing import TYPE_CHECKING

import pytest

from instruments.safe_state import UnsafeBench
from labctl.bench.opening import opened
from labctl.bench.signals import (
    UNDER_WAY,
    Interruption,
    StoppedBySignal,
    interruptible,
    stops_deferred,
    stops_heard,
)
from labctl.bench.station import Station

if TYPE_CHECKING:
    from _typeshed import TraceFunction

STOPS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
AT_ONCE = [[signal.SIGINT, signal.SIGINT], [signal.SIGTERM], [signal.SIGHUP]]


def send(signals: Sequence[signal.Signals]) -> None:
    for number in signals:
        os.kill(os.getpid(), number)


@pytest.fixture(autouse=True)
def handlers_as_before() -> Iterator[None]:
    before = [signal.getsignal(number) for number in STOPS]
    yield
    assert [signal.getsignal(number) for number in STOPS] == before


@pytest.mark.parametrize(("told", "said"), [((), "this shot"), ((UNDER_WAY,), "what is under way")])
def test_the_first_interrupt_asks(told: tuple[str, ...], said: str, capfd: pytest.CaptureFixture[str]) -> None:
    with interruptible(*told) as interruption:
        send([signal.SIGINT])
        assert interruption.requested
    assert f"stopping after {said};" in capfd.readouterr().err


@pytest.mark.parametrize("signals", AT_ONCE)
def test_the_second_interrupt_or_another_signal_stops_and_is_not_interrupted_itself(
    signals: list[signal.Signals],
) -> None:
    with interruptible() as interruption:
        with pytest.raises(StoppedBySignal):
            send(signals)
        send(STOPS)
        assert interruption.requested


class _Thing:
    pass


def test_a_stop_that_python_drops_ends_the_run_later_and_the_next_one_is_heard() -> None:
    """No error comes out of what is called when an object ends, and signals are handled there too."""
    with interruptible() as interruption:
        watched = weakref.ref(_Thing(), lambda _: signal.raise_signal(signal.SIGTERM))
        assert watched() is None
        assert interruption.requested
        with pytest.raises(StoppedBySignal):
            signal.raise_signal(signal.SIGINT)


def test_what_python_drops_besides_is_told_as_always(monkeypatch: pytest.MonkeyPatch) -> None:
    told: list[BaseException | None] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda dropped: told.append(dropped.exc_value))

    class Failing:
        def __del__(self) -> None:
            raise ValueError("of its own")

    with interruptible():
        Failing()
    assert [str(error) for error in told] == ["of its own"]


def test_a_run_is_not_suspended_with_its_light_on(capfd: pytest.CaptureFixture[str]) -> None:
    with interruptible() as interruption:
        send([signal.SIGTSTP])
        assert not interruption.requested
    assert "not suspended" in capfd.readouterr().err


def test_what_nohup_has_turned_off_stays_off() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with interruptible() as interruption:
            send([signal.SIGHUP])
            with stops_deferred():
                send([signal.SIGHUP])
            assert not interruption.requested
    finally:
        signal.signal(signal.SIGHUP, before)


def test_other_threads_run_without_signals() -> None:
    found: list[Interruption] = []

    def work() -> None:
        with interruptible() as interruption, stops_deferred():
            found.append(interruption)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert not found[0].requested


@pytest.mark.parametrize("number", STOPS)
def test_a_service_is_told_to_stop(number: signal.Signals) -> None:
    with stops_heard() as stopped:
        assert not stopped(0)
        os.kill(os.getpid(), number)
        assert stopped(60)


@pytest.mark.parametrize("line", range(8))
def test_a_service_is_told_to_stop_at_whatever_line_it_is(line: int) -> None:
    """Also where it begins or ends to wait: a lock that it has there must not be what hears the signal waits for."""
    lines = itertools.count()

    def signalled(_frame: FrameType, event: str, _argument: object) -> "TraceFunction":
        if event == "line" and next(lines) == line:
            signal.raise_signal(signal.SIGTERM)
        return signalled

    def serve(stopped: Callable[[float], bool]) -> None:
        while not stopped(1e-3):
            pass

    before = sys.gettrace()
    with stops_heard() as stopped:
        sys.settrace(signalled)
        try:
            serve(stopped)
        finally:
            sys.settrace(before)
        assert stopped(0)


class SignalsInTheCleanUp:
    """A transcript that gets this process signalled at the first message of the safe state."""

    def __init__(self, signals: Sequence[signal.Signals]) -> None:
        self.said: list[tuple[str, str]] = []
        self.arrived = False
        self._signals = signals

    def __call__(self, instrument: str, direction: str, message: str, /) -> None:
        self.said.append((instrument, message))
        if message == "OUTPUT OFF" and not self.arrived:
            self.arrived = True
            send(self._signals)


@pytest.mark.parametrize("signals", [*AT_ONCE, [signal.SIGINT] * 5, [*STOPS, *STOPS]])
def test_signals_in_the_clean_up_wait_until_the_bench_is_safe(signals: list[signal.Signals]) -> None:
    transcript = SignalsInTheCleanUp(signals)
    with opened(Station(), transcript) as found:
        with pytest.raises(StoppedBySignal), interruptible(), found.bench.emitting(1550.0):
            transcript.said.clear()
        assert transcript.arrived
        assert list(dict.fromkeys(name for name, _ in transcript.said)) == ["laser", "awg", "dmd", "scope"]
        assert found.bench.laser.settings()["emitting"] == 0
        assert found.bench.awg.settings()["output"] == 0
        assert not found.bench.lit


def test_one_interrupt_in_the_clean_up_asks_only() -> None:
    transcript = SignalsInTheCleanUp([signal.SIGINT])
    with opened(Station(), transcript) as found:
        with interruptible() as interruption, found.bench.emitting(1550.0):
            pass
        assert interruption.requested
        assert found.bench.laser.settings()["emitting"] == 0


def test_a_stop_that_waited_tells_what_the_safe_state_failed_at(capfd: pytest.CaptureFixture[str]) -> None:
    def fail() -> None:
        with interruptible(), stops_deferred():
            send([signal.SIGTERM])
            raise UnsafeBench("the safe state is not confirmed")

    with pytest.raises(StoppedBySignal):
        fail()
    said = capfd.readouterr().err
    assert "the bench is made safe first" in said
    assert "labctl: the safe state is not confirmed" in said
