"""Signals."""

import os
import signal
import threading

import pytest

from labctl.interruption import Interruption, StoppedBySignal, interruptible, on_stop_signal


def test_the_first_interrupt_asks(capsys: pytest.CaptureFixture[str]) -> None:
    with interruptible() as interruption:
        os.kill(os.getpid(), signal.SIGINT)
        assert interruption.requested
    assert "after this shot" in capsys.readouterr().err


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_the_second_interrupt_or_a_terminate_stops_and_is_not_interrupted_itself(number: int) -> None:
    before = signal.getsignal(signal.SIGINT)
    with interruptible() as interruption:
        if number == signal.SIGINT:
            os.kill(os.getpid(), signal.SIGINT)
        with pytest.raises(StoppedBySignal):
            os.kill(os.getpid(), number)
        os.kill(os.getpid(), signal.SIGINT)
        assert interruption.requested
    assert signal.getsignal(signal.SIGINT) is before


def test_other_threads_run_without_signals() -> None:
    found: list[Interruption] = []

    def work() -> None:
        with interruptible() as interruption:
            found.append(interruption)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert not found[0].requested


def test_a_service_is_told_to_stop() -> None:
    stop = threading.Event()
    with on_stop_signal(stop.set):
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.wait(1)
