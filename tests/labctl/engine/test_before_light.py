"""What is asked of a run before there is light is heard in the dark, and no person is asked for anything thereafter.

Nor does it wait for the ranges, in light that nothing was recorded in yet.
"""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import pytest

from instruments.alnair_tlg220 import Tlg220
from instruments.errors import InstrumentError
from instruments.safe_state import UnsafeBench
from labctl.bench import opening
from labctl.bench.opening import Access
from labctl.bench.signals import Interruption
from labctl.bench.station import SimSection, Station, WiringSection
from labctl.engine.session import Acquisition, Resumption, acquire, resume
from labctl.runs.live.control_file import Word, ask
from labctl.runs.live.events import EventReader
from labctl.runs.read.run import open_run
from protocols.dynamic_scene import DynamicScene
from protocols.image_readout import ImageReadout
from protocols.sequence_readout import SequenceReadout
from sim_backends.bench import SimulatedBench
from tests.observers import Follower

STATION = Station(wiring=WiringSection(burst=True), sim=SimSection(noise="by-state"))
BURST = ImageReadout(images=4, timing="burst", window=0.8e-9, ports=(2,))
SOFTWARE = ImageReadout(images=4, window=0.8e-9, ports=(2,))
SEQUENCE = SequenceReadout(symbols=700, ports=(2,))
SCENES = DynamicScene(scenes=1, images=4, window=1e-6, switch_after=0.5e-6, ports=(2,))
"""Pictures are uploaded before there is light, of bursts and of scenes."""
PANEL = {"driver": "manual-patch-panel", "ports": (2, 3, 4, 5, 6)}
HAND_LASER = {"driver": "manual-laser", "armed": True}


def emissions(directory: Path) -> list[bool]:
    """Light that came on, and that went out."""
    events = EventReader(directory / "events.jsonl").read()
    return [event.fields["on"] for event in events if event.name == "emission"]


def frames(directory: Path) -> str:
    with open_run(directory) as run:
        return run.digest()


def once_uploaded(what: str, act: Callable[[], object]) -> Follower:
    """Act when the first part of something is uploaded, and never again."""
    acted: list[str] = []

    def uploading(uploaded: str, _done: int, _total: int) -> None:
        if uploaded == what and not acted:
            acted.append(what)
            act()

    return Follower(uploading=uploading)


def at_probe(number: int, act: Callable[[], object]) -> tuple[Follower, list[None]]:
    """Act when the oscilloscope has given its records so often, all for the ranges; the list grows with each."""
    given: list[None] = []

    def acquired() -> None:
        given.append(None)
        if len(given) == number:
            act()

    return Follower(acquired=acquired), given


@pytest.mark.parametrize("protocol", [SOFTWARE, BURST, SCENES, SEQUENCE], ids=lambda protocol: protocol.name)
def test_a_stop_while_ranges_are_found_ends_the_light_before_the_next_probe(protocol: Any, tmp_path: Path) -> None:
    run = tmp_path / "run"
    stop, given = at_probe(2, lambda: ask(run, Word.STOP))
    station = STATION.model_copy(update={"wiring": WiringSection(burst=True, projector=protocol.projector)})
    outcome = acquire(Acquisition(protocol, station, run), observer=stop).outcome
    assert (outcome.complete, outcome.shots, len(given)) == (False, 0, 2)
    assert emissions(run) == [True, False]
    assert resume(Resumption(run)).complete


def test_a_stop_while_light_is_looked_for_does_not_wait_until_it_is_given_up(tmp_path: Path) -> None:
    """Which takes a minute of the bench."""
    run = tmp_path / "run"
    dark = Station(sim=SimSection(noise="by-state", parameters={"fibre_loss_db": 90.0}))
    stop, given = at_probe(60, lambda: ask(run, Word.STOP))
    outcome = acquire(Acquisition(SOFTWARE, dark, run), observer=stop).outcome
    assert (outcome.complete, len(given)) == (False, 60)


@pytest.mark.parametrize("protocol", [BURST, SCENES], ids=lambda protocol: protocol.name)
def test_a_stop_while_pictures_are_uploaded_needs_no_light(protocol: Any, tmp_path: Path) -> None:
    run = tmp_path / "run"
    stop = once_uploaded("DMD patterns", lambda: ask(run, Word.STOP))
    outcome = acquire(Acquisition(protocol, STATION, run), observer=stop).outcome
    assert (outcome.complete, emissions(run)) == (False, [])
    assert resume(Resumption(run)).complete
    acquire(Acquisition(protocol, STATION, tmp_path / "whole"))
    assert frames(run) == frames(tmp_path / "whole")


def test_a_pause_while_pictures_are_uploaded_is_dark_and_ends_in_the_same_frames(tmp_path: Path) -> None:
    run, waited = tmp_path / "run", list[list[bool]]()

    def wait(_seconds: float) -> None:
        waited.append(emissions(run))
        ask(run, Word.GO_ON)

    pause = once_uploaded("DMD patterns", lambda: ask(run, Word.PAUSE))
    acquired = acquire(Acquisition(BURST, STATION, run), observer=pause, interruption=Interruption(wait=wait))
    assert acquired.outcome.complete
    assert waited == [[]]
    acquire(Acquisition(BURST, STATION, tmp_path / "whole"))
    assert frames(run) == frames(tmp_path / "whole")


class Operator:
    """Somebody who moves the fibres of a simulated bench as asked, and presses Ctrl-C when asked for some words."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, stops_at: str) -> None:
        self.interruption = Interruption()
        self.asked: list[str] = []
        self._stops_at = stops_at
        self._benches: list[SimulatedBench] = []
        self._build = opening.simulated_bench
        monkeypatch.setattr(opening, "simulated_bench", self._bench)
        monkeypatch.setattr(opening, "ask_operator", self)

    def __call__(self, request: str) -> str:
        self.asked.append(request)
        self._benches[-1].world.patch({int(ch): int(port) for port, ch in re.findall(r"port (\d+) to CH(\d)", request)})
        self.interruption.requested |= self._stops_at in request
        return ""

    def _bench(self, *arguments: Any, **options: Any) -> SimulatedBench:
        self._benches.append(self._build(*arguments, **options))
        return self._benches[-1]


@pytest.mark.parametrize("laser", [{}, HAND_LASER], ids=["switched", "by hand"])
def test_who_presses_ctrl_c_when_asked_for_fibres_is_asked_for_nothing_more(
    laser: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    operator = Operator(monkeypatch, stops_at="port 2 to CH1")
    station = Station(patch_panel=PANEL, laser=laser, mixed=True)
    acquisition = Acquisition(ImageReadout(images=4), station, tmp_path / "run", access=Access(attended=True))
    assert not acquire(acquisition, interruption=operator.interruption).outcome.complete
    assert "connect port 2 to CH1" in operator.asked[-1]
    assert True not in emissions(tmp_path / "run")


def test_who_presses_ctrl_c_when_asked_to_move_fibres_between_passes_gets_no_light_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    operator = Operator(monkeypatch, stops_at="port 6 to CH1")
    acquisition = Acquisition(
        ImageReadout(images=4, window=0.8e-9), Station(patch_panel=PANEL, mixed=True), tmp_path / "run"
    )
    assert not acquire(acquisition, interruption=operator.interruption).outcome.complete
    assert emissions(tmp_path / "run").count(True) == 1
    with open_run(tmp_path / "run") as stored:
        assert stored.done == (6, 0)


def test_a_laser_that_does_not_obey_is_told_of_a_run_that_was_only_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = tmp_path / "run"

    def stuck(_laser: Tlg220) -> NoReturn:
        raise InstrumentError("laser: refuses OUTPUT OFF")

    def stop() -> None:
        monkeypatch.setattr(Tlg220, "make_safe", stuck)
        ask(run, Word.STOP)

    with pytest.raises(UnsafeBench, match=r"refuses OUTPUT OFF.*key switch"):
        acquire(Acquisition(BURST, STATION, run), observer=once_uploaded("waveform", stop))
