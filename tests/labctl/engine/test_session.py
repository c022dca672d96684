"""One acquisition from station and protocol to a stored run, on the simulated bench."""

import re
import sys
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

from instruments.alnair_tlg220 import Tlg220
from instruments.errors import LightLost, NoTrigger
from instruments.table_attenuator import TableAttenuator
from instruments.tektronix_awg70002a import TriggerInput
from labctl.bench.opening import opened
from labctl.bench.signals import Interruption
from labctl.bench.station import SimSection, Station, WiringSection
from labctl.engine.inputs import inputs_for
from labctl.engine.plan import Request, bytes_needed
from labctl.engine.recorder import COMPARED_EVERY
from labctl.engine.session import Acquisition, Resumption, acquire, resume
from labctl.errors import RunError
from labctl.runs.format.journal import read_journal
from labctl.runs.live.events import EventReader
from labctl.runs.live.logs import CommandLog
from labctl.runs.read.run import open_run
from labctl.studies.comparison import as_json, compare
from protocols.dynamic_scene import DynamicScene
from protocols.ghost_imaging import GhostImaging
from protocols.image_readout import ImageReadout
from protocols.sequence_readout import SequenceReadout
from tests.observers import Follower

BURSTS = Station(wiring=WiringSection(burst=True))
BY_STATE = BURSTS.model_copy(update={"sim": SimSection(noise="by-state")})
"""What was measured before changes no frame."""
PAST_THE_MIRRORS = Station(wiring=WiringSection(projector=False), sim=SimSection(noise="by-state"))
SHOTS = 22
PERIOD_SAMPLES, BURST_SAMPLES = 2500, 7500
ABOVE_ANY_PULSE_V = 4.0
"""A trigger level that the frame sync never crosses: the AWG sees as much of it as with its cable out."""


def bursts(**settings: Any) -> ImageReadout:
    return ImageReadout(images=20, timing="burst", **settings)


def test_a_frame_sync_that_stays_away_is_no_lost_link_and_loses_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr("instruments.tektronix_dpo72504dx.STALLED_S", 0.05)

    def cable_out_after_the_first_pass(done: int, _total: int) -> None:
        if done == SHOTS:
            monkeypatch.setattr(TriggerInput, "level_v", ABOVE_ANY_PULSE_V)

    with pytest.raises(NoTrigger, match="DMD frame sync -> AWG trigger input"):
        acquire(Acquisition(bursts(), BURSTS, tmp_path / "run"), observer=Follower(cable_out_after_the_first_pass))
    assert "lost link" not in caplog.text
    with open_run(tmp_path / "run") as stored:
        assert stored.done == (SHOTS, 0)
    log = (tmp_path / "run" / "commands.log").read_text()
    assert log.count("> laser OUTPUT ON") == 1
    assert log.rindex("> laser OUTPUT OFF") > log.rindex("> laser OUTPUT ON")


def test_what_was_measured_when_somebody_may_have_stopped_the_light_is_in_doubt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked = count()

    def shut_in_the_end(_attenuator: TableAttenuator) -> None:
        if next(looked) > 6:
            raise LightLost("attenuator: is shut and was open")

    monkeypatch.setattr(TableAttenuator, "require_open", shut_in_the_end)
    attenuated = Station.model_validate({"attenuator": {"driver": "table-attenuator", "commands": "simulated"}})
    with pytest.raises(LightLost):
        acquire(Acquisition(ImageReadout(images=400, ports=(2, 3), window=0.4e-9), attenuated, tmp_path / "run"))
    with open_run(tmp_path / "run") as stored:
        assert 0 < stored.suspect <= COMPARED_EVERY
        assert sum(stored.done) > 0
    log = (tmp_path / "run" / "commands.log").read_text()
    assert log.count("> laser OUTPUT ON") == 1, "who shuts it does not find it open again"


def test_what_the_sample_rate_folds_back_is_noted_once_when_a_run_starts(tmp_path: Path) -> None:
    noted = {}
    filtered = Station.model_validate({"scope": {"bandwidth": "12.5 GHz"}})
    for name, station in (("whole", Station()), ("filtered", filtered)):
        protocol = ImageReadout(images=2, classes=(0, 1), ports=(2,), window=0.4e-9)
        acquire(Acquisition(protocol, station, tmp_path / name))
        events = EventReader(tmp_path / name / "events.jsonl").read()
        noted[name] = [event.fields["text"] for event in events if event.name == "warning"]
    (line,) = noted["whole"]
    assert line.startswith("25 GS/s, 25 GHz wide: frequencies above 12.5 GHz fold back below it: set scope.bandwidth")
    assert noted["filtered"] == []


@pytest.mark.parametrize(
    ("protocol", "steps"),
    [
        (bursts(), ["upload", "dmd", "arm", "physics", "transfer", "comparison", "storage_beside_the_next_burst"]),
        (ImageReadout(images=20), ["upload", "dmd", "arm", "trigger", "physics", "transfer", "comparison", "storage"]),
    ],
)
def test_the_time_of_a_shot_by_steps(protocol: ImageReadout, steps: list[str], tmp_path: Path) -> None:
    acquired = acquire(Acquisition(protocol, BURSTS, tmp_path / "run", profile=True))
    measured = {step for step, milliseconds in acquired.budget.items() if milliseconds > 0}
    assert measured >= set(steps)
    assert not {"storage", "storage_beside_the_next_burst"} - set(steps) & measured
    assert 0 < sum(acquired.budget.values()) / 1e3 * acquired.outcome.shots < 1.5 * acquired.outcome.seconds


def test_uploads_are_told_while_they_last(tmp_path: Path) -> None:
    told: list[tuple[str, int, int]] = []
    acquire(
        Acquisition(bursts(ports=(2,)), BURSTS, tmp_path / "run"),
        observer=Follower(uploading=lambda *upload: told.append(upload)),
    )
    assert told[0] == ("DMD patterns", SHOTS, SHOTS)
    assert set(told[1:]) == {("waveform", PERIOD_SAMPLES, PERIOD_SAMPLES), ("waveform", BURST_SAMPLES, BURST_SAMPLES)}


def test_a_burst_is_reported_as_done_once_it_is_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("protocols.bursts.LONGEST_BURST", 8)
    reported: list[int] = []

    def compare(done: int, _total: int) -> None:
        reported.append(done)
        stored = read_journal(tmp_path / "run" / "journal.jsonl").entries
        assert done <= sum(entry.count for entry in stored)

    acquire(Acquisition(bursts(), BURSTS, tmp_path / "run"), observer=Follower(compare))
    assert reported == [8, 16, SHOTS, SHOTS + 8, SHOTS + 16, 2 * SHOTS]


def test_the_manifest_has_the_light_as_the_laser_settled_on_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Tlg220, "_number", near_what_was_asked(Tlg220._number))
    protocol = ImageReadout(images=20, ports=(2,), wavelengths=(1551.0, 1552.0))
    acquire(Acquisition(protocol, Station(), tmp_path / "run"))
    with open_run(tmp_path / "run") as stored:
        light, laser = stored.manifest["light"], stored.manifest["instruments"]["laser"]["settings"]
    assert light["wavelength_nm"] == pytest.approx(1551.004, abs=1e-6)
    assert light["power_w"] == pytest.approx(Station().laser.power, rel=1e-2)
    assert laser["wavelength_nm"] == light["wavelength_nm"]
    assert laser["emitting"] == 0


@pytest.mark.parametrize(
    ("protocol", "records"),
    [
        (DynamicScene(images=40, scenes=2, averages=3, ports=(2,), switch_after=0.5e-6, window=0.8e-6), 1),
        (ImageReadout(images=10, reference_every=3, averages=2, window=0.8e-9, wavelengths=(1550.0, 1551.0)), 40),
        (ImageReadout(images=10, reference_every=3, window=0.8e-9, ports=(2,)), 3),
        (bursts(window=0.8e-9), SHOTS),
        (bursts(window=0.8e-9, averages=3), SHOTS),
        (SequenceReadout(symbols=100, ports=(2, 3, 4, 5, 6)), 1),
    ],
)
def test_a_run_that_was_stopped_goes_on_to_the_same_frames(protocol: Any, records: int, tmp_path: Path) -> None:
    interruption, station = Interruption(), BY_STATE if protocol.projector else PAST_THE_MIRRORS

    def stop(done: int, _total: int) -> None:
        interruption.requested = done == records

    acquire(Acquisition(protocol, station, tmp_path / "whole"))
    stopped = acquire(
        Acquisition(protocol, station, tmp_path / "run"), interruption=interruption, observer=Follower(stop)
    )
    assert not stopped.outcome.complete
    assert resume(Resumption(tmp_path / "run")).complete
    with open_run(tmp_path / "whole") as whole, open_run(tmp_path / "run") as resumed:
        assert resumed.digest() == whole.digest()
        assert resumed.manifest["seeds"] == whole.manifest["seeds"]


@pytest.mark.parametrize(
    "protocol",
    [
        ImageReadout(images=20, window=0.4e-9, ports=(2,)),
        bursts(window=0.4e-9, ports=(2,)),
        GhostImaging(images=4, patterns=4, ports=(2,), timing="burst"),
        DynamicScene(images=40, scenes=1, ports=(2,), switch_after=0.5e-6, window=0.8e-6),
    ],
)
def test_time_is_after_the_trigger(protocol: Any, tmp_path: Path) -> None:
    acquire(Acquisition(protocol, BURSTS, tmp_path / "run"))
    sent = re.findall(r"HORizontal:MAIn:DELay:TIMe ([-+.E\d]+)", (tmp_path / "run" / "commands.log").read_text())
    with open_run(tmp_path / "run") as stored:
        assert stored.time[0] == (float(sent[-1]) if sent else 0.0)
        assert (stored.time[0] > 0) == (protocol.name == "dynamic-scene" or protocol.timing == "burst")


def test_a_burst_whose_frames_began_elsewhere_is_not_gone_on_with(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interruption = Interruption(requested=True)
    with monkeypatch.context() as earlier:
        earlier.setattr(ImageReadout, "start_s", lambda *_: 0.0)
        acquire(Acquisition(bursts(window=0.4e-9), BURSTS, tmp_path / "run"), interruption=interruption)
    with pytest.raises(
        RunError, match="makes another start of frames from the run's settings: resume with the version"
    ):
        resume(Resumption(tmp_path / "run"))


def test_a_burst_is_compared_with_single_shots_from_the_first_sample_on(tmp_path: Path) -> None:
    single = ImageReadout(images=20, window=0.8e-9, averages=8, ports=(2,))
    runs = tmp_path / "single", tmp_path / "burst"
    for directory, protocol in zip(runs, (single, single.model_copy(update={"timing": "burst"})), strict=True):
        acquire(Acquisition(protocol, BURSTS, directory))
    assert as_json(compare(*runs))["same_image"]["correlation"]["port 2"] > 0.9


@pytest.mark.parametrize("whole", [True, False])
def test_what_is_found_of_damage_is_told_when_a_run_goes_on(whole: bool, tmp_path: Path) -> None:
    interruption, told = Interruption(), list[str]()
    protocol = ImageReadout(images=4, classes=(0, 1), ports=(2,), window=0.4e-9)

    def stop(done: int, _total: int) -> None:
        interruption.requested = not whole and done == 3

    acquire(Acquisition(protocol, BY_STATE, tmp_path / "run"), interruption=interruption, observer=Follower(stop))
    with open_run(tmp_path / "run") as stored:
        before = stored.digest()
    (tmp_path / "run" / "shards" / "000000.h5").write_bytes(b"")
    assert resume(Resumption(tmp_path / "run"), observer=Follower(warning=told.append)).complete
    line = f"{tmp_path / 'run'}/shards/000000.h5: was missing or damaged, and is made again from data.h5"
    assert told.count(line) == 1
    assert (tmp_path / "run" / "commands.log").read_text().count(line) == (not whole)
    with open_run(tmp_path / "run") as stored:
        assert (stored.digest() == before) == whole


@pytest.mark.parametrize(
    "protocol",
    [
        ImageReadout(images=20, window=0.4e-9),
        bursts(window=0.8e-9),
        bursts(window=0.8e-9, averages=5),
        DynamicScene(images=40, scenes=2, averages=3, ports=(2,), switch_after=0.5e-6, window=0.8e-6),
    ],
)
def test_a_run_takes_no_more_room_than_was_asked_for(protocol: Any, tmp_path: Path) -> None:
    with CommandLog() as log, opened(BURSTS, log) as found:
        allowed = bytes_needed(Request(protocol, inputs_for(protocol, None), BURSTS), found.bench)
    acquire(Acquisition(protocol, BURSTS, tmp_path / "run"))
    files = [path.stat() for path in (tmp_path / "run").rglob("*") if path.is_file()]
    taken = sum(max(file.st_size, 512 * file.st_blocks) for file in files)
    assert taken <= allowed


def near_what_was_asked(number: Callable[[Tlg220, str], float]) -> Callable[[Tlg220, str], float]:
    """The replies of a laser that settles 4 pm beside what it is asked for."""
    return lambda laser, name: number(laser, name) + (0.004 if name == "get_wavelength" else 0.0)


def test_a_run_without_the_card_that_it_asks_for_says_so_once_and_is_measured(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    monkeypatch.delitem(sys.modules, "sim_backends.world.card", raising=False)  # which has it already
    station = Station(sim=SimSection(device="cuda"))
    acquired = acquire(Acquisition(ImageReadout(images=4), station, tmp_path / "run"))
    assert acquired.outcome.complete
    told = "sim.device = cuda: torch is not installed: the simulated bench is computed on the processor"
    noted = [event.fields.get("text") for event in EventReader(tmp_path / "run" / "events.jsonl").read()]
    assert noted.count(told) == 1
