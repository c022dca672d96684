"""What a plain pyvisa client sees: change one instrument, and the oscilloscope's bytes follow as physics says."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvisa
from numpy.typing import NDArray
from pyvisa.resources import MessageBasedResource

Served = tuple[dict[str, Any], Path]

SAMPLES = 200
SCENES = {"bar": np.s_[4:24, 4:10], "beam": np.s_[4:10, 4:24]}


class PlainClient:
    """A script somebody might write with pyvisa and the instruments' manuals, knowing nothing of labctl."""

    def __init__(self, resources: dict[str, dict[str, str]]) -> None:
        visa = pyvisa.ResourceManager("@py")
        self.session: dict[str, MessageBasedResource] = {}
        for name, addresses in resources.items():
            session = visa.open_resource(addresses["hislip"], read_termination="\n", write_termination="\n")
            assert isinstance(session, MessageBasedResource)
            self.session[name] = session
        self.setup()

    def write(self, instrument: str, *commands: str) -> None:
        for command in commands:
            self.session[instrument].write(command)

    def query(self, instrument: str, command: str) -> str:
        return str(self.session[instrument].query(command))

    def setup(self) -> None:
        self.upload_drive(seed=1)
        self.laser("WAVELENGTH 1550.0000", "POWER 14.77", "OUTPUT ON")
        self.write("patch_panel", "ROUT:OPEN:ALL", "ROUT:CLOS (@1!2)")
        assert self.query("dmd", "ALP:DEVALLOC") == "0"
        self.sequence = int(self.query("dmd", "ALP:SEQALLOC 1,1").split(",")[1])
        for line in ("SEQCONTROL {},2110,2", "SEQCONTROL {},2104,2106", "SEQTIMING {},0,0,0,0,0"):
            assert self.query("dmd", "ALP:" + line.format(self.sequence)) == "0"
        self.write(
            "scope",
            "*RST",
            "HEADER OFF",
            "HOR:MODE MAN;:HOR:MODE:SAMPLER 25E9;RECO 200;:HOR:POS 0",
            "TRIG:A:EDGE:SOU AUX;:TRIG:AUXL 0.5;:TRIG:A:MOD NORM",
            "SEL:CH1 ON;:CH1:SCA 0.01;OFFS 0.03",
            "ACQ:STOPA SEQ;:DAT:SOU CH1;ENC SRI;STAR 1;STOP 200",
        )

    def upload_drive(self, seed: int) -> None:
        samples = np.random.default_rng(seed).uniform(-1, 1, 2500).astype("<f4")
        self.write("awg", "AWGC:STOP", "WLIS:WAV:DEL ALL", 'WLIS:WAV:NEW "m",2500')
        self.session["awg"].write_binary_values('WLIS:WAV:DATA "m",', samples.tolist(), datatype="f")
        marker = np.where(np.arange(2500) < 100, 0x40, 0).astype(np.uint8)
        self.session["awg"].write_binary_values('WLIS:WAV:MARK:DATA "m",', marker.tolist(), datatype="B")
        self.write("awg", "SOUR1:DAC:RES 9", 'SOUR1:CASS:WAV "m"', "AWGC:RUN")
        assert self.query("awg", "*OPC?") == "1"
        self.write("awg", "OUTP:OFF 0", "OUTP1 1")
        assert self.query("awg", "SYST:ERR?").startswith("0,")

    def laser(self, *commands: str) -> None:
        self.write("laser", *commands)
        while self.query("laser", "SETTLED?") != "1":
            pass

    def show(self, scene: str) -> None:
        superpixels = np.zeros((28, 28), bool)
        superpixels[SCENES[scene]] = True
        mirrors = np.zeros((768, 1024), bool)
        mirrors[6:762, 134:890] = np.kron(superpixels, np.ones((27, 27), bool))
        assert self.query("dmd", "ALP:PROJHALT") == "0"
        bits = np.packbits(mirrors, axis=1).ravel()
        self.session["dmd"].write_binary_values(f"ALP:SEQPUT {self.sequence},0,1,", bits.tolist(), datatype="B")
        assert self.session["dmd"].read() == "0"
        assert self.query("dmd", f"ALP:PROJSTARTCONT {self.sequence}") == "0"

    def trace(self) -> NDArray[np.float64]:
        self.write("scope", "ACQ:STATE RUN")
        assert self.query("scope", "*OPC?") == "1"
        codes = self.session["scope"].query_binary_values("CURV?", datatype="b")
        assert len(codes) == SAMPLES
        return np.asarray(codes, np.float64)


@pytest.fixture(scope="module")
def client(served: Served) -> PlainClient:
    return PlainClient(served[0])


@pytest.fixture
def noise(client: PlainClient) -> float:
    """Root mean square difference of two traces of the same scene: the measure of every change below."""
    client.show("bar")
    first, second = client.trace(), client.trace()
    assert not np.array_equal(first, second)
    return float(np.sqrt(np.mean((first - second) ** 2)))


def change(first: NDArray[np.float64], second: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean((first - second) ** 2)))


def test_the_same_image_again_is_the_same_within_the_noise(client: PlainClient, noise: float) -> None:
    before = client.trace()
    client.show("beam")
    client.show("bar")
    assert change(before, client.trace()) < 1.5 * noise


def test_another_image(client: PlainClient, noise: float) -> None:
    before = client.trace()
    client.show("beam")
    assert change(before, client.trace()) > 2 * noise


def test_darkness(client: PlainClient, noise: float) -> None:
    lit = client.trace()
    client.laser("OUTPUT OFF")
    dark = client.trace()
    client.laser("OUTPUT ON")
    assert np.std(lit) > 3 * np.std(dark)
    assert dark.mean() < lit.mean()
    assert change(lit, client.trace()) < 1.5 * noise


def test_a_tenth_of_a_nanometre(client: PlainClient, noise: float) -> None:
    before = client.trace()
    client.laser("WAVELENGTH 1550.1000")
    shifted = client.trace()
    client.laser("WAVELENGTH 1550.0000")
    assert change(before, shifted) > 2 * noise
    assert abs(np.corrcoef(before, shifted)[0, 1]) < 0.6
    assert change(before, client.trace()) < 1.5 * noise


def test_another_port(client: PlainClient, noise: float) -> None:
    before = client.trace()
    client.write("patch_panel", "ROUT:CLOS (@1!5)")
    assert client.query("patch_panel", "*OPC?") == "1"
    assert change(before, client.trace()) > 2 * noise
    client.write("patch_panel", "ROUT:CLOS (@1!2)")
    assert client.query("patch_panel", "*OPC?") == "1"
    assert change(before, client.trace()) < 1.5 * noise


def test_another_drive(client: PlainClient, noise: float) -> None:
    before = client.trace()
    client.upload_drive(seed=2)
    other = client.trace()
    client.upload_drive(seed=1)
    assert change(before, other) > 2 * noise
    assert change(before, client.trace()) < 1.5 * noise
