"""slmsuite's DLPC900 interface, unmodified: in the place of hidapi it gets a module whose cable is a TCP connection."""

import socket
import struct
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

_ti = pytest.importorskip("slmsuite.hardware.slms.texasinstruments", reason="slmsuite is absent: `make interop`")
pytest.importorskip("pyvisa_py")

REPORT = 64
INITIALISE_IMAGE, LOAD_IMAGE = 0x1A2A, 0x1A2B
ROW_OF_BIT_0 = b"\x80\x0f\x00\x00\x01\x00\x00"  # 1920 times blue 0, green 0, red 1; end of line
SAME_ROW = b"\x00\x01\x80\x0f\x00\x00"


class Cable:
    """`hid.device` as slmsuite uses it."""

    def open_path(self, path: bytes) -> None:
        host, port = path.decode().split(":")
        self._socket = socket.create_connection((host, int(port)))

    def write(self, data: list[int]) -> int:
        assert data[0] == 0
        assert len(data) == 1 + REPORT
        self._socket.sendall(bytes(data[1:]))
        return len(data)

    def read(self, size: int, timeout_ms: int) -> list[int]:
        self._socket.settimeout(timeout_ms / 1e3)
        report = b""
        while len(report) < size:
            report += self._socket.recv(size - len(report))
        return list(report)

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def dlpc(resources_with_dlpc900: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    host, port = resources_with_dlpc900["dmd"]["socket"].split("::")[1:3]

    def enumerate_devices(_vendor: int, _product: int) -> list[dict[str, Any]]:
        return [{"path": f"{host}:{port}".encode(), "product_string": "DLPC900"}]

    monkeypatch.setattr(_ti, "_hid", SimpleNamespace(enumerate=enumerate_devices, device=Cable))
    monkeypatch.setattr(_ti, "HID_AVAILABLE", True)
    opened = _ti.DLPC900()
    yield opened
    opened.reset()
    opened.close()


@pytest.fixture
def light(resources_with_dlpc900: Any, visa: Callable[[str], Any]) -> Iterator[Callable[[], float]]:
    """Laser, AWG and oscilloscope run; what is called gives the light on channel 1, V peak to peak."""
    laser, awg, scope, switch = (
        visa(resources_with_dlpc900[name]["hislip"]) for name in ("laser", "awg", "scope", "patch_panel")
    )
    laser.write("*RST;POWER 14.8;OUTPUT ON")
    while laser.query("SETTLED?") != "1":
        pass
    switch.write("ROUTe:CLOSe (@1!2)")
    samples = np.random.default_rng(3).uniform(-1, 1, 2500).astype(np.float32)
    marker = np.repeat(np.array([0x40, 0], np.uint8), (50, 2450))
    awg.write('SOURce1:DAC:RESolution 9;:CLOCk:SRATe 2.5E10;:WLISt:WAVeform:NEW "light",2500')
    assert awg.query("*OPC?") == "1"
    awg.write_binary_values('WLISt:WAVeform:DATA "light",0,2500,', samples, datatype="f")
    awg.write_binary_values('WLISt:WAVeform:MARKer:DATA "light",0,2500,', marker, datatype="B")
    for line in ('SOURce1:CASSet:WAVeform "light"', "AWGControl:RUN", "OUTPut:OFF 0", "OUTPut1 1"):
        awg.write(line)
    assert awg.query("*OPC?") == "1"
    for line in (
        *("HEADer OFF", "HORizontal:MODE MANual", "HORizontal:MODE:SAMPLERate 25E9"),
        *("HORizontal:MODE:RECOrdlength 500", "HORizontal:POSition 0", "CH1:SCAle 0.02", "SELect:CH1 ON"),
        *("TRIGger:A:MODe NORMal", "TRIGger:A:EDGE:SOUrce AUX", "TRIGger:AUXLevel 0.5"),
        *("ACQuire:STOPAfter SEQuence", "DATa:ENCdg SRIbinary;:DATa:SOUrce CH1;STARt 1;STOP 500"),
    ):
        scope.write(line)

    def measure() -> float:
        scope.write("ACQuire:STATE RUN")
        assert scope.query("*OPC?") == "1"
        codes = scope.query_binary_values("CURVe?", datatype="b", container=np.array)
        return float(np.ptp(codes.astype(float)) * float(scope.query("WFMOutpre:YMUlt?")))

    yield measure
    laser.query("OUTPUT OFF;*OPC?")


def upload(dlpc: Any) -> None:
    """Image 0: bit 0 of every pixel on, the others off; its interface has no words of its own for images."""
    body = ROW_OF_BIT_0 + SAME_ROW * 1079 + b"\0\1\0"
    body += bytes(-len(body) % 4)
    image = struct.pack("<4sHHI8sIBBB21x", b"Spld", 1920, 1080, 48 + len(body), b"\xff" * 8, 0, 0, 2, 1) + body
    dlpc._send("w", INITIALISE_IMAGE, list(struct.pack("<HI", 0, len(image))))
    for start in range(0, len(image), 504):
        chunk = image[start : start + 504]
        dlpc._send("w", LOAD_IMAGE, list(struct.pack("<H", len(chunk)) + chunk))


def on_the_fly(dlpc: Any) -> None:
    """Stop, choose the mode, and wait for it, as slmsuite itself does."""
    dlpc.stop_pattern()
    dlpc.set_display_mode("otf")
    dlpc._poll_until(lambda: dlpc.get_display_mode().name == "OTF", interval_s=0.01, error_msg="no change of mode")


def test_it_is_found_and_well(dlpc: Any) -> None:
    assert [number for number, _path in dlpc.info(verbose=False)] == [0]
    status = dlpc.get_hardware_status()
    assert status.pop("init_done")
    assert not any(status.values())
    assert dlpc.get_firmware_version()
    assert dlpc.get_display_mode().name == "PATTERN"


def test_patterns_are_light_and_dark(dlpc: Any, light: Callable[[], float]) -> None:
    on_the_fly(dlpc)
    seen = []
    for bit in (0, 1):
        dlpc.define_pattern(0, image_index=0, bit_position=bit)
        dlpc.configure_pattern_lut(1)
        upload(dlpc)  # anew after every change of the table, says the guide
        dlpc.start_pattern()
        assert dlpc.get_main_status()["sequencer_running"]
        seen.append(light())
        dlpc.stop_pattern()
        assert not dlpc.get_main_status()["sequencer_running"]
    assert seen[0] > 4 * seen[1]


def test_a_sequence_ends_by_itself(dlpc: Any) -> None:
    on_the_fly(dlpc)
    for index in range(2):
        dlpc.define_pattern(index, trigger_out2=True, image_index=0, bit_position=index)
    dlpc.configure_pattern_lut(2, num_repeats=2)  # so many patterns, says the guide
    upload(dlpc)
    dlpc.start_pattern()
    dlpc._poll_until(lambda: not dlpc.get_main_status()["sequencer_running"], interval_s=0.01, error_msg="goes on")
    assert not any(dlpc.get_hardware_status()[name] for name in ("sequencer_abort", "sequencer_error"))
