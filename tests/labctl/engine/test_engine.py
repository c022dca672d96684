"""The engine: what it refuses to store, and how it stops."""

from pathlib import Path

import numpy as np
import pytest

from instruments.bench import Observer
from instruments.errors import InstrumentError
from instruments.values import Frames
from labctl.bench.opening import OpenBench
from labctl.bench.operator import ask_operator
from labctl.bench.signals import Interruption
from labctl.bench.station import SIMULATED_STATION, Station
from labctl.engine.engine import Outcome, carry_out
from labctl.engine.inputs import images_for
from labctl.engine.plan import Request
from labctl.runs.read.run import open_run
from protocols.base import ShotKind
from protocols.image_readout import ImageReadout
from tests.observers import Follower

PROTOCOL = ImageReadout(images=40)


def run(
    open_bench: OpenBench,
    directory: Path,
    *,
    observer: Observer | None = None,
    interruption: Interruption | None = None,
) -> Outcome:
    request = Request(PROTOCOL, images_for(PROTOCOL), Station())
    open_bench.bench.observer = observer or Observer()
    return carry_out(request, open_bench.bench, interruption or Interruption(), directory)


def test_the_same_trace_twice_is_an_error_and_what_was_measured_is_kept(
    open_bench: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = open_bench.bench.scope.read
    taken: list[Frames] = []

    def stuck() -> Frames:
        """An oscilloscope that stops acquiring after a while and returns its last trace."""
        taken.append(read() if len(taken) < 120 else taken[-1])
        return taken[-1]

    monkeypatch.setattr(open_bench.bench.scope, "read", stuck)
    with pytest.raises(InstrumentError, match=r"byte-identical traces at shots .*: it did not acquire anew"):
        run(open_bench, tmp_path / "run")
    assert open_bench.bench.laser.settings()["emitting"] == 0
    with open_run(tmp_path / "run") as stored:
        assert not stored.complete
        assert stored.done[0] > 0


def test_a_reference_that_strays_once_is_measured_again(
    open_bench: OpenBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Chance gives a record that looks like another picture's; it does so once."""
    protocol = ImageReadout(images=200, ports=(2, 3, 4, 5), window=2e-9)
    kinds = [shot.kind for shot in protocol.shots(images_for(protocol))]
    strays_at = [place for place, kind in enumerate(kinds) if kind is ShotKind.REFERENCE][4]
    read, at, last = open_bench.bench.scope.read, [0], list[Frames]()

    def stray() -> Frames:
        last.append(read())
        return last[-4] if at == [strays_at] and at.pop() else last[-1]

    def progress(done: int, _total: int) -> None:
        at[:] = [done] if at else []

    monkeypatch.setattr(open_bench.bench.scope, "read", stray)
    monkeypatch.setattr("labctl.engine.recovery.PAUSE_S", 0.0)
    inputs = images_for(protocol)
    open_bench.bench.observer = Follower(progress)
    request = Request(protocol, inputs, SIMULATED_STATION)
    outcome = carry_out(request, open_bench.bench, Interruption(), tmp_path / "run")
    assert (outcome.complete, outcome.recovered) == (True, 1)


def test_an_interruption_finishes_the_shot(open_bench: OpenBench, tmp_path: Path) -> None:
    interruption = Interruption()

    def progress(done: int, _total: int) -> None:
        interruption.requested = done == 50

    outcome = run(open_bench, tmp_path / "run", interruption=interruption, observer=Follower(progress))
    assert not outcome.complete
    assert outcome.shots == 6
    assert open_bench.bench.laser.settings()["emitting"] == 0
    with open_run(tmp_path / "run") as stored:
        assert stored.done == (44, 6)
        assert np.array_equal(stored.shots["index"], np.arange(6))


def test_nobody_at_the_terminal(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr("builtins.input", lambda: "")
    assert ask_operator("press Enter") == ""

    def closed() -> str:
        raise EOFError

    monkeypatch.setattr("builtins.input", closed)
    with pytest.raises(InstrumentError, match="nobody answered"):
        ask_operator("press Enter")
    assert "press Enter" in capsys.readouterr().err
