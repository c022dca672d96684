"""A session with the virtual generator: what it tells the world, and its upload."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sim_backends.virtual import VirtualAwg70002a, VirtualInstrument
from sim_backends.world.signals import Playback
from sim_backends.world.world import World

Ask = Callable[[VirtualInstrument, str | bytes], bytes]

SAMPLES = np.random.default_rng(7).uniform(-1, 1, 2500).astype(np.float32)
MARKERS = np.repeat(np.array([0x40, 0x00], np.uint8), [50, 2450])


class Heard(World):
    """A world that notes what it is told to play."""

    def __init__(self) -> None:
        super().__init__()
        self.played: list[Playback | None] = []
        self.triggers = 0
        self.level = (0.0, True)

    @property
    def last(self) -> Playback | None:
        """What it plays now."""
        return self.played[-1] if self.played else None

    def play(self, playback: Playback | None) -> None:
        self.played.append(playback)
        super().play(playback)

    def trigger_awg(self) -> None:
        self.triggers += 1
        super().trigger_awg()

    def awg_trigger_level(self, level_v: float, *, rising: bool) -> None:
        self.level = level_v, rising
        super().awg_trigger_level(level_v, rising=rising)


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
