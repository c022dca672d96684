"""The DMD driver through the vendor's Python library.

The vendor's shared library is not to be had here. In its place stands a module with ALP4lib's own signatures that
passes every call on to the simulated device, so the driver and its conversions run unchanged.
"""

import ctypes
import sys
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from instruments.alp_library import AlpByVendorLibrary, AlpOverVisa
from instruments.driver import Opening
from instruments.errors import InstrumentError, NotConfigured
from instruments.interfaces import BurstDmd
from instruments.vialux_alp import DRIVER, VialuxAlp, VialuxAlpSection
from instruments.visa import VisaLink
from sim_backends.bench import SimulatedBench
from sim_backends.virtual.alp.instrument import VirtualAlp


class ALPError(Exception):
    """Named as in ALP4lib."""


class VendorLibrary:
    """ALP4lib 1.1's class ALP4: same names, same arguments, same types, with the simulated device behind it."""

    device: AlpOverVisa
    sequence_bytes = 768 * 128

    def __init__(self, version: str = "4.3", libDir: str | None = None) -> None:  # noqa: N803
        if libDir == "nowhere":
            raise OSError("libalp43.so: cannot open shared object file")

    def _pass_on(self, call: Any, *arguments: Any) -> Any:
        try:
            return call(*arguments)
        except InstrumentError as error:
            raise ALPError(str(error)) from None

    def Initialize(self, DeviceNum: int | None = None) -> None:  # noqa: N802, N803
        self._pass_on(self.device.Initialize)

    def DevInquire(self, inquireType: int) -> ctypes.c_long:  # noqa: N802, N803
        return ctypes.c_long(self._pass_on(self.device.DevInquire, inquireType))

    def SeqAlloc(self, nbImg: int = 1, bitDepth: int = 1) -> ctypes.c_long:  # noqa: N802, N803
        return ctypes.c_long(self._pass_on(self.device.SeqAlloc, nbImg, bitDepth))

    def SeqControl(self, controlType: int, value: int, SequenceId: Any = None) -> None:  # noqa: N802, N803
        self._pass_on(self.device.SeqControl, SequenceId.value, controlType, value)

    def SeqPut(  # noqa: N802
        self,
        imgData: Any,  # noqa: N803
        SequenceId: Any = None,  # noqa: N803
        PicOffset: int = 0,  # noqa: N803
        PicLoad: int = 0,  # noqa: N803
        dataFormat: str = "Python",  # noqa: N803
    ) -> None:
        assert dataFormat == "C"
        frames = np.ctypeslib.as_array(imgData, (PicLoad, 768, 128))
        self._pass_on(self.device.SeqPut, SequenceId.value, PicOffset, frames)

    def Run(self, SequenceId: Any = None, loop: bool = True) -> None:  # noqa: N802, N803
        self._pass_on(partial(self.device.Run, loop=loop), SequenceId.value)

    def SetTiming(  # noqa: N802
        self,
        SequenceId: Any = None,  # noqa: N803
        pictureTime: int | None = None,  # noqa: N803
        synchPulseWidth: int | None = None,  # noqa: N803
    ) -> None:
        self._pass_on(self.device.SeqTiming, SequenceId.value, pictureTime, synchPulseWidth)

    def SeqInquire(self, inquireType: int, SequenceId: Any = None) -> ctypes.c_long:  # noqa: N802, N803
        return ctypes.c_long(self._pass_on(self.device.SeqInquire, SequenceId.value, inquireType))

    def Halt(self) -> None:  # noqa: N802
        self._pass_on(self.device.Halt)

    def FreeSeq(self, SequenceId: Any = None) -> None:  # noqa: N802, N803
        self._pass_on(self.device.FreeSeq, SequenceId.value)

    def Free(self) -> None:  # noqa: N802
        self._pass_on(self.device.Free)


@pytest.fixture
def vendor(simulation: SimulatedBench, log: Any, monkeypatch: pytest.MonkeyPatch) -> AlpOverVisa:
    link = VisaLink(simulation.resources["dmd"]["socket"], name="dmd", timeout_s=5, transcript=log)
    module = ModuleType("ALP4")
    module.__dict__.update(ALP4=VendorLibrary, ALPError=ALPError)
    monkeypatch.setitem(sys.modules, "ALP4", module)
    VendorLibrary.device = AlpOverVisa(link)
    return VendorLibrary.device


def opening(address: str = "usb") -> Opening:
    return Opening(address, lambda *_: None, input, attended=False)


def test_the_same_driver_over_usb(vendor: AlpOverVisa, log: Any) -> None:
    dmd = DRIVER.open(VialuxAlpSection(driver="vialux-alp", address="usb"), opening())
    assert isinstance(dmd, BurstDmd)
    dmd.self_test()
    pattern = np.random.default_rng(0).integers(0, 256, (768, 128), dtype=np.uint8)
    dmd.show(pattern)
    assert dmd.shape == (768, 1024)
    assert dmd.settings()["free_pictures"]
    assert dmd.identify().manufacturer == "ViALUX"
    dmd.load(iter([np.stack([pattern, pattern]), pattern[np.newaxis]]), 3)
    dmd.play(1, 2, 50e-6)
    dmd.make_safe()
    dmd.close()
    assert log.sent_to("dmd")[-1] == "ALP:DEVFREE"


def test_its_errors_are_told_in_words(vendor: AlpOverVisa) -> None:
    library = AlpByVendorLibrary("4.3", None)
    with pytest.raises(InstrumentError, match=r"dmd: SeqAlloc failed: .*returned 10\d\d"):
        library.SeqAlloc(1, 1)


def test_a_missing_library_is_named(vendor: AlpOverVisa) -> None:
    with pytest.raises(NotConfigured, match=r"ALP 4\.3 cannot be loaded: libalp43\.so"):
        VialuxAlp(AlpByVendorLibrary("4.3", "nowhere"))


@pytest.mark.parametrize("lacking", ["__init__", "Initialize", "DevInquire"])
def test_a_library_without_a_function_is_told_in_one_line(
    vendor: AlpOverVisa, monkeypatch: pytest.MonkeyPatch, lacking: str
) -> None:
    def call(*_arguments: object, **_named: object) -> None:
        ctypes.CDLL(None).AlpDevAlloc()

    call.__name__ = lacking
    monkeypatch.setattr(VendorLibrary, lacking, call)
    with pytest.raises(NotConfigured, match=r"^dmd: the ViALUX library .*AlpDevAlloc") as refused:
        DRIVER.open(VialuxAlpSection(driver="vialux-alp", address="usb"), opening()).identify()
    assert "\n" not in str(refused.value)


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ALP4", None)
    with pytest.raises(NotConfigured, match=r"pip install 'photonic-labctl\[alp\]'"):
        AlpByVendorLibrary("4.3", None)


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


def test_closing_closes_the_link_whatever_the_device_answers(simulation: SimulatedBench, log: Any) -> None:
    sessions = Sessions()
    address = simulation.resources["dmd"]["socket"]
    dmd = VialuxAlp(AlpOverVisa(VisaLink(address, name="dmd", timeout_s=5, transcript=sessions)))
    dmd.blank()
    other = VisaLink(address, name="dmd", timeout_s=5, transcript=log)
    assert [other.query(line) for line in ("ALP:DEVHALT", "ALP:DEVFREE")] == ["0", "0"]
    assert sessions.open == 1
    with pytest.raises(InstrumentError, match=r"ALP:DEVHALT returned 1003"):
        dmd.close()
    assert sessions.open == 0
    dmd.close()
    assert sessions.open == 0
    other.close()


def test_closing_closes_the_link_of_a_device_that_could_not_be_allocated(
    simulation: SimulatedBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    sessions = Sessions()
    link = VisaLink(simulation.resources["dmd"]["socket"], name="dmd", timeout_s=5, transcript=sessions)
    dmd = VialuxAlp(AlpOverVisa(link))
    monkeypatch.setattr(VirtualAlp, "allocate", lambda _device, _serial: 1010)
    with pytest.raises(InstrumentError, match="ALP:DEVALLOC returned 1010"):
        dmd.blank()
    assert sessions.open == 1
    dmd.close()
    assert sessions.open == 0


def test_so_many_mirrors_as_no_dmd_has(simulation: SimulatedBench, log: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(AlpOverVisa, "DevInquire", lambda _self, _item: 10**12)
    link = VisaLink(simulation.resources["dmd"]["socket"], name="dmd", timeout_s=5, transcript=log)
    with pytest.raises(InstrumentError, match="1000000000000 mirrors a side"):
        VialuxAlp(AlpOverVisa(link)).blank()
    link.close()


def test_a_reply_that_is_no_return_code(simulation: SimulatedBench, log: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    link = VisaLink(simulation.resources["dmd"]["socket"], name="dmd", timeout_s=5, transcript=log)
    monkeypatch.setattr(VirtualAlp, "halt", lambda _device: "ready")
    library = AlpOverVisa(link)
    with pytest.raises(InstrumentError, match="dmd: ALP:DEVHALT was answered 'ready', not with a return code"):
        library.Halt()
    library.close()
