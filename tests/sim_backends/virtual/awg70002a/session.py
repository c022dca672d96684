"""A session with the virtual generator: its upload, and its start."""

import numpy as np
from numpy.typing import NDArray

from sim_backends.virtual import VirtualAwg70002a
from tests.sim_backends.virtual.watched import Ask

SAMPLES = np.random.default_rng(7).uniform(-1, 1, 2500).astype(np.float32)
MARKERS = np.repeat(np.array([0x40, 0x00], np.uint8), [50, 2450])


def block(data: bytes) -> bytes:
    return f"#{len(str(len(data)))}{len(data)}".encode() + data


def float_block(samples: NDArray[np.float32]) -> bytes:
    return block(samples.astype("<f4").tobytes())


def upload(ask: Ask, awg: VirtualAwg70002a, samples: NDArray[np.float32] = SAMPLES, name: str = "m") -> None:
    ask(awg, f'WLISt:WAVeform:NEW "{name}",{samples.size}')
    ask(awg, f'WLISt:WAVeform:DATA "{name}",0,{samples.size},'.encode() + float_block(samples))


def errors(ask: Ask, awg: VirtualAwg70002a) -> str:
    return ask(awg, "SYSTem:ERRor:CODE:ALL?").decode()


def start(ask: Ask, awg: VirtualAwg70002a, bits: int = 9) -> None:
    """The upload session of the instrument facts, 1.10."""
    ask(awg, f"*RST\n*WAI\n*CLS\nCLOCk:SRATe 2.5E10\nSOURce1:DAC:RESolution {bits}\nSOURce1:VOLTage 0.5")
    assert ask(awg, "*OPC?;:CLOCk:SRATe?") == b"1;2.5000000000E+10"
    ask(awg, "WLISt:WAVeform:DELete ALL")
    upload(ask, awg)
    ask(awg, b'WLISt:WAVeform:MARKer:DATA "m",0,2500,#42500' + MARKERS.tobytes())
    ask(awg, 'SOURce1:CASSet:WAVeform "m"')
    ask(awg, "SOURce1:MARKer1:VOLTage:HIGH 1.0;LOW 0.0\nSOURce1:RMODe CONTinuous\nAWGControl:RUN")
    ask(awg, "OUTPut:OFF 0\nOUTPut1:STATe 1")
    assert errors(ask, awg) == "0"
