"""The DMD driver through ALP4lib as it comes from the registry, and over the network.

ALP4lib loads `tests.alp_shared_library` in place of the vendor's shared library, so every call of the driver goes
through ALP4lib and C to the simulated device.
"""

import platform
import sys
from collections.abc import Iterator
from typing import Any

import ALP4
import numpy as np
import pytest
from numpy.typing import NDArray

from instruments.alp_library import RETURN_CODES, AlpByVendorLibrary, AlpOverVisa
from instruments.driver import Opening
from instruments.errors import InstrumentError, LinkError, NotConfigured, OutOfRange
from instruments.interfaces import BurstDmd
from instruments.values import Drive
from instruments.vialux_alp import DRIVER, VialuxAlp, VialuxAlpSection
from instruments.visa import VisaLink
from sim_backends.bench import SimulatedBench
from sim_backends.optics.mirrors import on_counts
from sim_backends.virtual.alp import codes
from sim_backends.virtual.alp.instrument import MEMORY, SERIAL, VirtualAlp
from sim_backends.world.keyed_random import digest
from tests.alp_shared_library import SharedLibrary, in_place_of_the_vendors

PATTERN, OTHER, THIRD = np.random.default_rng(0).integers(0, 256, (3, 768, 128), dtype=np.uint8)
LOST = (1001, 1011, 1012)
PICTURE_S = 33.334e-3
"""How long a sequence shows a picture that nobody has given a time."""


@pytest.fixture
def library(simulation: SimulatedBench) -> Iterator[SharedLibrary]:
    """What ALP4lib gets when it loads the vendor's library."""
    with in_place_of_the_vendors(simulation.resources["dmd"]["socket"]) as found:
        yield found


def opening(address: str = "usb") -> Opening:
    return Opening(address, lambda *_: None, input, attended=False)


def opened(address: str = "usb", **keys: Any) -> BurstDmd:
    dmd = DRIVER.open(VialuxAlpSection(driver="vialux-alp", address=address, **keys), opening(address))
    assert isinstance(dmd, BurstDmd)
    return dmd


@pytest.fixture
def dmd(library: SharedLibrary) -> Iterator[BurstDmd]:
    found = opened()
    yield found
    found.close()


def shows(simulation: SimulatedBench, mirrors: NDArray[np.uint8]) -> bool:
    """Whether these mirrors are what the light meets now."""
    standing, _ = simulation.world._pictures.standing(simulation.world.clock.now)
    return standing == digest(on_counts(mirrors[np.newaxis])[0].tobytes())


class TestByUsb:
    def test_a_picture_stays_without_a_dark_phase(self, dmd: BurstDmd, simulation: SimulatedBench) -> None:
        assert dmd.shape == (768, 1024)
        dmd.show(PATTERN)
        for _ in range(200):
            simulation.world.clock.advance(PICTURE_S / 100 - 1e-6)
            assert shows(simulation, PATTERN)

    def test_the_next_picture_takes_its_place(self, dmd: BurstDmd, simulation: SimulatedBench) -> None:
        dmd.show(PATTERN)
        dmd.show(OTHER)
        assert shows(simulation, OTHER)
        dmd.blank()
        assert shows(simulation, np.zeros_like(PATTERN))

    def test_who_it_is(self, dmd: BurstDmd) -> None:
        dmd.self_test()
        assert dmd.identify().manufacturer == "ViALUX"
        assert dmd.identify().serial == str(SERIAL)
        assert dmd.settings()["free_pictures"] == MEMORY - 1

    def test_pictures_are_played_without_a_dark_phase(self, dmd: BurstDmd, simulation: SimulatedBench) -> None:
        dmd.load(iter([np.stack([PATTERN, OTHER]), THIRD[np.newaxis]]), 3)
        dmd.play(1, 2, 1e-3)
        for mirrors in (OTHER, THIRD):
            assert shows(simulation, mirrors)
            simulation.world.clock.advance(0.94e-3)
            assert shows(simulation, mirrors)
            simulation.world.clock.advance(0.06e-3)
        assert shows(simulation, THIRD)

    def test_rounds_follow_each_other_without_a_pause(self, dmd: BurstDmd, simulation: SimulatedBench) -> None:
        dmd.load(iter([np.stack([PATTERN, OTHER])]), 2)
        dmd.play(0, 2, 1e-3, rounds=2)
        for mirrors in (PATTERN, OTHER, PATTERN, OTHER):
            simulation.world.clock.advance(0.1e-3)
            assert shows(simulation, mirrors)
            simulation.world.clock.advance(0.9e-3)
        assert shows(simulation, OTHER)
        dmd.play(0, 2, 1e-3)
        simulation.world.clock.advance(2.1e-3)
        assert shows(simulation, OTHER), "and the next time once"

    def test_faster_than_the_mirrors_is_refused(self, dmd: BurstDmd) -> None:
        dmd.load(iter([PATTERN[np.newaxis]]), 1)
        with pytest.raises(OutOfRange, match="time between pictures = 43 us"):
            dmd.play(0, 1, 43e-6)

    def test_holding_keeps_the_picture(self, dmd: BurstDmd, simulation: SimulatedBench) -> None:
        dmd.show(PATTERN)
        dmd.hold()
        simulation.world.clock.advance(1.0)
        assert shows(simulation, PATTERN)

    def test_the_picture_stays_while_the_next_one_is_loaded(
        self, dmd: BurstDmd, simulation: SimulatedBench, library: SharedLibrary
    ) -> None:
        dmd.show(PATTERN)
        library.returns["AlpSeqPut"] = 1006
        with pytest.raises(InstrumentError, match="SeqPut returned 1006"):
            dmd.show(OTHER)
        assert shows(simulation, PATTERN)

    def test_a_halt_that_takes_its_time(
        self, dmd: BurstDmd, library: SharedLibrary, simulation: SimulatedBench
    ) -> None:
        dmd.show(PATTERN)
        library.slow_to_halt = 3
        dmd.show(OTHER)
        assert shows(simulation, OTHER)

    def test_a_second_load_takes_the_place_of_the_first(self, dmd: BurstDmd, simulation: SimulatedBench) -> None:
        for mirrors in (PATTERN, OTHER):
            dmd.load(iter([mirrors[np.newaxis]] * 30), 30)
            dmd.play(0, 30, 50e-6)
            simulation.world.clock.advance(1.0)
            assert shows(simulation, mirrors)
            assert dmd.settings()["free_pictures"] == MEMORY - 31

    def test_more_pictures_than_there_is_room_for(self, dmd: BurstDmd) -> None:
        with pytest.raises(OutOfRange, match=f"pictures in the DMD's memory = {MEMORY}"):
            dmd.load(iter([]), MEMORY)

    def test_closed_it_is_free_and_can_be_opened_again(self, library: SharedLibrary, log: Any) -> None:
        for _ in range(2):
            dmd = opened()
            dmd.load(iter([PATTERN[np.newaxis]]), 1)
            dmd.show(PATTERN)
            dmd.close()
            dmd.close()
            assert library.called[-1] == "AlpDevFree"
            dmd.show(PATTERN)
            dmd.close()

    def test_nobody_changed_anything(self, dmd: BurstDmd, simulation: SimulatedBench) -> None:
        dmd.show(PATTERN)
        assert dmd.changes() == ()
        virtual(simulation).halt_projection()
        virtual(simulation).control_projection(2306, 1)
        assert {change.setting for change in dmd.changes()} == {"inversion", "projection"}

    def test_nothing_is_printed(self, dmd: BurstDmd, capfd: pytest.CaptureFixture[str]) -> None:
        dmd.show(PATTERN)
        dmd.close()
        assert capfd.readouterr() == ("", "")


class TestByUsbWhatGoesWrong:
    @pytest.mark.parametrize("code", LOST)
    def test_a_lost_device_is_a_lost_link_and_comes_back(
        self, dmd: BurstDmd, library: SharedLibrary, simulation: SimulatedBench, code: int
    ) -> None:
        dmd.load(iter([OTHER[np.newaxis]]), 1)
        dmd.show(PATTERN)
        library.returns["AlpSeqPut"] = code
        with pytest.raises(LinkError, match=rf"^dmd: SeqPut returned {code}: "):
            dmd.show(PATTERN)
        library.returns.clear()
        dmd.make_safe()
        dmd.show(PATTERN)
        assert shows(simulation, PATTERN)
        assert dmd.capacity() == MEMORY - 1

    def test_a_pulled_cable(self, dmd: BurstDmd, library: SharedLibrary, simulation: SimulatedBench) -> None:
        dmd.show(PATTERN)
        library.unplug()
        with pytest.raises(LinkError, match="returned 1012"):
            dmd.show(PATTERN)
        dmd.make_safe()
        dmd.show(PATTERN)
        assert shows(simulation, PATTERN)

    def test_a_device_that_does_not_come_back(self, dmd: BurstDmd, library: SharedLibrary) -> None:
        dmd.show(PATTERN)
        library.unplug()
        library.returns["AlpDevAlloc"] = 1001
        for action in (dmd.blank, dmd.make_safe, dmd.make_safe):
            with pytest.raises(LinkError, match=r"returned 10(01|12)"):
                action()
        library.returns.clear()
        dmd.make_safe()

    @pytest.mark.parametrize("code", [*sorted(set(RETURN_CODES) - set(LOST)), 4711])
    def test_every_return_code_is_one_line(self, dmd: BurstDmd, library: SharedLibrary, code: int) -> None:
        dmd.show(PATTERN)
        library.returns["AlpProjStartCont"] = code
        with pytest.raises(InstrumentError, match=rf"^dmd: Run returned {code}: .{{9,}}") as failed:
            dmd.show(PATTERN)
        assert not isinstance(failed.value, LinkError)
        assert "\n" not in str(failed.value)

    def test_pictures_that_somebody_inverted_are_dark_when_it_is_safe(
        self, dmd: BurstDmd, simulation: SimulatedBench
    ) -> None:
        dmd.show(PATTERN)
        virtual(simulation).halt_projection()
        virtual(simulation).control_projection(codes.INVERSION, 1)
        dmd.make_safe()
        assert shows(simulation, np.zeros_like(PATTERN))

    def test_memory_that_cannot_be_freed_is_told(self, dmd: BurstDmd, library: SharedLibrary) -> None:
        dmd.load(iter([PATTERN[np.newaxis]]), 1)
        library.returns["AlpSeqFree"] = 1008
        with pytest.raises(InstrumentError, match="FreeSeq returned 1008: the sequence is in use"):
            dmd.load(iter([PATTERN[np.newaxis]]), 1)
        library.returns.clear()

    def test_a_device_that_cannot_be_prepared_is_not_kept(self, library: SharedLibrary) -> None:
        dmd = opened()
        library.returns["AlpSeqAlloc"] = 1007
        for _ in range(2):
            with pytest.raises(InstrumentError, match="SeqAlloc returned 1007"):
                dmd.blank()
        dmd.close()
        library.returns.clear()
        again = opened()
        again.blank()
        again.close()

    def test_a_device_that_somebody_else_has(self, library: SharedLibrary, simulation: SimulatedBench) -> None:
        other = opened(simulation.resources["dmd"]["socket"])
        other.show(PATTERN)
        dmd = opened()
        with pytest.raises(InstrumentError, match=r"Initialize returned 1004: in use: another program"):
            dmd.show(OTHER)
        assert shows(simulation, PATTERN)
        other.close()
        dmd.show(OTHER)
        dmd.close()

    def test_the_device_of_a_serial_number(self, library: SharedLibrary) -> None:
        dmd = opened(serial_number=SERIAL)
        assert dmd.identify().serial == str(SERIAL)
        dmd.close()
        with pytest.raises(LinkError, match=r"Initialize returned 1001: .*dmd\.serial_number"):
            opened(serial_number=SERIAL + 1).identify()

    def test_a_library_that_cannot_be_loaded(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(platform, "system", lambda: "Linux")
        with pytest.raises(NotConfigured, match=r"ALP 4\.3 cannot be loaded: /nowhere/libalp43\.so: "):
            AlpByVendorLibrary("4.3", "/nowhere")

    @pytest.mark.parametrize(
        ("system", "version", "reason"),
        [("Darwin", "4.3", "Cannot auto detect libDir"), ("Linux", "9.9", "Version not supported")],
    )
    def test_a_library_that_is_not_to_be_found(
        self, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], system: str, version: str, reason: str
    ) -> None:
        monkeypatch.setattr(platform, "system", lambda: system)
        with pytest.raises(NotConfigured, match=f"^dmd: the ViALUX library for ALP {version} .*{reason}") as refused:
            AlpByVendorLibrary(version, None)
        assert "\n" not in str(refused.value)
        assert capfd.readouterr() == ("", "")

    @pytest.mark.parametrize("lacking", ["AlpDevAlloc", "AlpSeqControl", "AlpProjHalt"])
    def test_a_library_without_a_function_is_told_in_one_line(self, library: SharedLibrary, lacking: str) -> None:
        delattr(library, lacking)
        with pytest.raises(NotConfigured, match=rf"^dmd: the ViALUX library .*{lacking}") as refused:
            opened().blank()
        assert "\n" not in str(refused.value)

    def test_a_missing_package_is_named(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setitem(sys.modules, "ALP4", None)
        with pytest.raises(NotConfigured, match=r'pip install "photonic-labctl\[alp\]"'):
            AlpByVendorLibrary("4.3", None)

    def test_what_alp4lib_knows_of_return_codes_is_known_here(self) -> None:
        assert ALP4.ALP_ERRORS.keys() <= RETURN_CODES.keys()


class TestTriggerIn:
    """Cables of the simulated bench: the AWG's marker 1 is the DMD's trigger input."""

    @pytest.fixture(params=["usb", "network"])
    def dmd(self, request: pytest.FixtureRequest, simulation: SimulatedBench) -> Iterator[BurstDmd]:
        if request.param == "usb":
            request.getfixturevalue("library")
        found = opened("usb" if request.param == "usb" else simulation.resources["dmd"]["socket"], trigger_in="rising")
        yield found
        found.close()

    def test_pictures_advance_at_the_markers_of_the_awg(
        self, dmd: BurstDmd, bench: Any, simulation: SimulatedBench, log: Any
    ) -> None:
        dmd.blank()
        drive = Drive("still", np.zeros(2500, np.float32), 25e9, 0.5)
        bench.awg.load(drive, periods_per_trigger=1)
        bench.awg.play()
        dmd.load(iter([np.stack([PATTERN, OTHER, THIRD])]), 3)
        dmd.play(0, 3, 44e-6)
        link = VisaLink(simulation.resources["awg"]["socket"], name="awg", timeout_s=5, transcript=log)
        for mirrors in (PATTERN, OTHER, THIRD):
            simulation.world.clock.advance(1e-3)
            assert not shows(simulation, mirrors)
            link.write("TRIGger:IMMediate ATRigger")
            assert link.query("*OPC?") == "1"
            simulation.world.clock.advance(20e-6)
            assert shows(simulation, mirrors)
        link.close()
        dmd.show(OTHER)
        assert shows(simulation, OTHER), "a picture that is shown waits for no trigger"
        assert dmd.changes() == ()


class Sessions:
    """A transcript that counts the sessions that are open."""

    def __init__(self) -> None:
        self.open = 0

    def __call__(self, instrument: str, direction: str, message: str, /) -> None: ...

    def tap(self, instrument: str, resource: str) -> "Sessions":
        self.open += 1
        return self

    def heard(self, direction: str, chunks: Any) -> None: ...

    def closed(self) -> None:
        self.open -= 1


def virtual(simulation: SimulatedBench) -> VirtualAlp:
    """The device itself, of a bench that is idle."""
    device = simulation._instruments["dmd"]
    assert isinstance(device, VirtualAlp)
    return device


def over_network(simulation: SimulatedBench, transcript: Any) -> AlpOverVisa:
    address = simulation.resources["dmd"]["socket"]
    return AlpOverVisa(VisaLink(address, name="dmd", timeout_s=5, transcript=transcript))


def test_closing_closes_the_link_whatever_the_device_answers(simulation: SimulatedBench) -> None:
    sessions = Sessions()
    dmd = VialuxAlp(over_network(simulation, sessions))
    dmd.blank()
    virtual(simulation).reset()
    assert sessions.open == 1
    with pytest.raises(InstrumentError, match=r"ALP:PROJHALT returned 1003"):
        dmd.close()
    assert sessions.open == 0
    dmd.close()
    assert sessions.open == 0


def test_closing_closes_the_link_of_a_device_that_could_not_be_allocated(
    simulation: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = Sessions()
    dmd = VialuxAlp(over_network(simulation, sessions))
    monkeypatch.setattr(VirtualAlp, "allocate", lambda _device, _serial: 1010)
    with pytest.raises(InstrumentError, match="ALP:DEVALLOC returned 1010"):
        dmd.blank()
    assert sessions.open == 1
    dmd.close()
    assert sessions.open == 0


def test_so_many_mirrors_as_no_dmd_has(simulation: SimulatedBench, log: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(AlpOverVisa, "DevInquire", lambda _self, _item: 10**12)
    library = over_network(simulation, log)
    with pytest.raises(InstrumentError, match="1000000000000 mirrors a side"):
        VialuxAlp(library).blank()
    library.close()


def test_a_reply_that_is_no_return_code(simulation: SimulatedBench, log: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(VirtualAlp, "halt_projection", lambda _device: "ready")
    library = over_network(simulation, log)
    with pytest.raises(InstrumentError, match="dmd: ALP:PROJHALT was answered 'ready', not with a return code"):
        library.ProjHalt()
    library.close()
