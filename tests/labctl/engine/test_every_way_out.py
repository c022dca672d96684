"""Whatever raises wherever it raises: the simulated world is dark afterwards, and what was measured is kept."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest

from instruments.errors import InstrumentError, LinkError
from instruments.tektronix_dpo72504dx import Dpo72504dx
from instruments.vialux_alp import VialuxAlp
from labctl.bench import opening
from labctl.bench.station import DurabilitySection, SimSection, Station
from labctl.commands.main import main
from labctl.engine.session import Acquisition, acquire
from labctl.errors import RunError
from labctl.runs.read.run import open_run
from labctl.runs.verification import verify_run
from labctl.runs.write.writer import RunWriter
from protocols.base import Events, Images, Part
from protocols.image_readout import ImageReadout
from sim_backends.faults.bench import FaultyBench
from tests.faults.matrix import SAFE
from tests.observers import Follower

STATION = Station(
    sim=SimSection(parameters={"chip_modes": 50}),
    durability=DurabilitySection(shots=2, seconds=3600),
)
SETTINGS = {"images": 4, "ports": (2, 3, 4, 5, 6), "window": 0.4e-9}


class Unforeseen(BaseException):
    """What a plug-in may raise."""


KINDS = (ZeroDivisionError, MemoryError, SystemExit, KeyboardInterrupt, Unforeseen, OSError)


@pytest.fixture(autouse=True)
def simulation(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[], FaultyBench]]:
    """The bench that the last run was on, which has ended by then: what was sent to it has been executed."""
    made: list[FaultyBench] = []
    build = opening.simulated_bench

    def keep(*arguments: Any, **options: Any) -> FaultyBench:
        made.append(build(*arguments, **options))
        return made[-1]

    monkeypatch.setattr(opening, "simulated_bench", keep)
    yield lambda: made[-1]
    (bench,) = made
    assert not [name for name, is_safe in SAFE.items() if not is_safe(bench)]


def run(directory: Path, protocol: ImageReadout | None = None, **options: Any) -> None:
    acquire(Acquisition(protocol or ImageReadout(**SETTINGS), STATION, directory), **options)


def raising(error: BaseException) -> Callable[..., NoReturn]:
    def fail(*_arguments: object, **_options: object) -> NoReturn:
        raise error

    return fail


def kept(directory: Path, at_least: int = 1) -> None:
    """The run is whole as far as it goes, and has so many records."""
    assert verify_run(directory).intact
    with open_run(directory) as stored:
        assert sum(stored.done) >= at_least


class Wrapping(ImageReadout):
    """A protocol from elsewhere that passes on what another one yields, until it fails itself."""

    fails_after: int

    def acquire(self, bench: Any, inputs: Images, parts: Any) -> Events:
        events = super().acquire(bench, inputs, parts)
        for place, event in enumerate(events):
            if place == self.fails_after:
                raise ZeroDivisionError("in the protocol")
            yield event


class Ending(ImageReadout):
    """One that fails when everything is measured."""

    def acquire(self, bench: Any, inputs: Images, parts: list[Part]) -> Events:  # type: ignore[override]
        with bench.emitting(parts[0].pass_.wavelength_nm):
            yield from super().acquire(bench, inputs, parts)
            raise ZeroDivisionError("in the protocol")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # of the generator that was left
@pytest.mark.parametrize(("fails_after", "stored"), [(0, 0), (1, 0), (3, 2), (7, 6)])
def test_a_protocol_that_fails_with_another_ones_light_on(fails_after: int, stored: int, tmp_path: Path) -> None:
    """Before the first record, after it, in the first pass, as the second begins."""
    with pytest.raises(ZeroDivisionError):
        run(tmp_path / "run", Wrapping(fails_after=fails_after, **SETTINGS))
    kept(tmp_path / "run", stored)


def test_a_protocol_that_fails_at_its_end(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError):
        run(tmp_path / "run", Ending(**SETTINGS))
    assert verify_run(tmp_path / "run").complete


@pytest.mark.parametrize("kind", KINDS)
def test_what_progress_raises(kind: type[BaseException], tmp_path: Path) -> None:
    def progress(done: int, _total: int) -> None:
        if done == 3:
            raise kind

    with pytest.raises(kind):
        run(tmp_path / "run", observer=Follower(progress))
    kept(tmp_path / "run", 3)


@pytest.mark.parametrize("method", ["append", "scales", "sync", "finish"])
@pytest.mark.parametrize("error", [RunError("full"), MemoryError()])
def test_what_storage_raises(method: str, error: Exception, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RunWriter, method, raising(error))
    with pytest.raises(type(error)):
        run(tmp_path / "run")
    kept(tmp_path / "run", 0)


def test_what_a_burst_raises_in_the_thread_that_stores_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(RunWriter, "append", raising(MemoryError()))
    wired = STATION.model_copy(update={"wiring": STATION.wiring.model_copy(update={"burst": True})})
    with pytest.raises(MemoryError):
        acquire(Acquisition(ImageReadout(timing="burst", **SETTINGS), wired, tmp_path / "run"))


@pytest.mark.parametrize("kind", KINDS)
def test_what_comes_in_the_midst_of_the_clean_up(
    kind: type[BaseException], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After the DMD is blank, while the oscilloscope is still to be stopped; the run has failed already."""
    blank = VialuxAlp.make_safe

    def interrupted(dmd: VialuxAlp) -> None:
        blank(dmd)
        raise kind

    def progress(done: int, _total: int) -> None:
        if done == 3:
            monkeypatch.setattr(Dpo72504dx, "read", raising(InstrumentError("scope: fails")))

    monkeypatch.setattr(VialuxAlp, "make_safe", interrupted)
    with pytest.raises((kind, InstrumentError)):
        run(tmp_path / "run", observer=Follower(progress))
    kept(tmp_path / "run", 3)


@pytest.mark.parametrize("kind", [ZeroDivisionError, MemoryError, RunError])
def test_what_is_told_of_a_run_cannot_harm_it(
    kind: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("labctl.commands.run.describe", raising(kind("told")))
    station = tmp_path / "station.toml"
    station.write_text("[sim.parameters]\nchip_modes = 50\n", encoding="utf-8")
    with pytest.raises((kind, SystemExit)):
        main(["run", "image-readout", "--set", "images=4", "--station", str(station), "--out", str(tmp_path / "run")])
    assert verify_run(tmp_path / "run").complete


def test_an_instrument_and_then_the_disk_are_both_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = shutil.disk_usage(tmp_path)._replace(free=0)

    def progress(done: int, _total: int) -> None:
        if done == 3:
            monkeypatch.setattr(Dpo72504dx, "read", raising(LinkError("scope at nowhere cannot be reached")))
            monkeypatch.setattr("labctl.runs.write.room.shutil.disk_usage", lambda _path: full)

    hoarding = STATION.model_copy(update={"durability": DurabilitySection(shots=1000, seconds=3600)})
    with pytest.raises(LinkError, match="scope at nowhere") as failure:
        acquire(Acquisition(ImageReadout(**SETTINGS), hoarding, tmp_path / "run"), observer=Follower(progress))
    (note,) = set(failure.value.__notes__)
    assert note.startswith(f"{tmp_path / 'run' / 'shards' / '000000.h5'}: cannot be written: No space left on device")
