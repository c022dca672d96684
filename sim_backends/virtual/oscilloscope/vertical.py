"""Vertical settings of the virtual oscilloscope: what turns volts at a channel's input into codes.

Source: instrument facts 2.3. Numbers that are only recalled are module constants.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from sim_backends.scpi.arguments import Real, boolean, keyword, quoted, real
from sim_backends.scpi.commands import Setting
from sim_backends.scpi.status import ScpiError

CHANNELS = {f"CH{number}": number for number in (1, 2, 3, 4)}
LOWEST_SCALE_V, HIGHEST_SCALE_V = 6.25e-3, 0.6  # V/div, recalled
OFFSET_LIMIT_V = 10.0  # recalled; the real limit depends on the scale
BIAS_LIMIT_V = 3.5  # recalled
BANDWIDTH_HZ = 25e9
LOWEST_BANDWIDTH_HZ = 5e6
DESKEW_LIMIT_S = 125e-9
DESKEW_STEP_S = 40e-12
HIGHEST_ATTENUATION, HIGHEST_ATTENUATION_DB = 1e10, 200  # tm_devices: CH<x>:PROBEFunc


class _Ohms(Real):
    """A resistance, replied as `50.0000`."""

    def format(self, value: float, *, verbose: bool) -> str:
        return f"{value:.4f}"


_BANDWIDTH = real(
    LOWEST_BANDWIDTH_HZ, BANDWIDTH_HZ, FULl=BANDWIDTH_HZ, TWEnty=20e6, TWOfifty=250e6, ONEfifty=150e6, FIVe=500e6
)

VERTICAL_COMMANDS = (
    Setting("SELect:CH#", "channels#.selected", boolean),
    Setting("CH#:SCAle", "channels#.scale_v", real(LOWEST_SCALE_V, HIGHEST_SCALE_V)),
    Setting("CH#:OFFSet", "channels#.offset_v", real(-OFFSET_LIMIT_V, OFFSET_LIMIT_V)),
    Setting("CH#:POSition", "channels#.position_div", real(-8, 8)),
    Setting("CH#:BANdwidth", "channels#.bandwidth_hz", _BANDWIDTH),
    Setting("CH#:BANdwidth:ENHanced", "channels#.enhanced", keyword("AUTO", "OFF")),
    Setting("CH#:BANdwidth:ENHanced:FORCe", "channels#.enhancement_forced", boolean),
    Setting("CH#:BANdwidth:ENHanced:APPLYtoall", "enhances_all", boolean),
    Setting("CH#:BANdwidth:ENHanced:STATE?", "channels#.enhancing", boolean),
    Setting("CH#:COUPling", "channels#.coupling", keyword("AC", "DC", "DCREJect", "GND")),
    Setting("CH#:TERmination", "channels#.termination_ohm", _Ohms(minimum=50, maximum=50), effect=False),
    Setting("CH#:VTERm:BIAS", "channels#.bias_v", real(-BIAS_LIMIT_V, BIAS_LIMIT_V), effect=False),
    Setting("CH#:INVert", "channels#.inverted", boolean),
    Setting("CH#:DESKew", "channels#.deskew_s", real(-DESKEW_LIMIT_S, DESKEW_LIMIT_S)),
    Setting("CH#:LABel[:NAMe]", "channels#.label", quoted, effect=False),
    Setting("CH#:PROBEFunc:EXTAtten", "channels#.attenuation", real(1 / HIGHEST_ATTENUATION, HIGHEST_ATTENUATION)),
    Setting(
        "CH#:PROBEFunc:EXTDBatten", "channels#.attenuation_db", real(-HIGHEST_ATTENUATION_DB, HIGHEST_ATTENUATION_DB)
    ),
)


class Vertical(NamedTuple):
    """What turns volts into codes: all volts are those in front of an external attenuator."""

    scale_v: float
    offset_v: float
    position_div: float
    inverted: bool
    attenuation: float = 1.0
    bandwidth_hz: float = BANDWIDTH_HZ
    grounded: bool = False
    deskew_s: float = 0.0

    @property
    def limit_hz(self) -> float:
        """What an `Acquisition` of this input is limited to."""
        return self.bandwidth_hz if self.bandwidth_hz < BANDWIDTH_HZ else math.inf


@dataclass
class Channel:
    """Vertical settings of one channel. The front end is 50 ohm and couples DC; other couplings need a probe."""

    selected: bool = False
    scale_v: float = 0.1
    offset_v: float = 0.0
    position_div: float = 0.0
    bandwidth_hz: float = BANDWIDTH_HZ
    enhanced: str = "AUTO"
    enhancement_forced: bool = False
    termination_ohm: float = 50.0
    bias_v: float = 0.0
    inverted: bool = False
    label: str = ""
    _attenuation: float = 1.0
    _coupling: str = "DC"
    _deskew_s: float = 0.0

    @property
    def coupling(self) -> str:
        """DC, or GND for the grounded input; -221 when set to what only probes offer."""
        return self._coupling

    @coupling.setter
    def coupling(self, word: str) -> None:
        if word not in ("DC", "GND"):
            raise ScpiError(-221, f"no probe offers {word.upper()} coupling")
        self._coupling = word

    @property
    def deskew_s(self) -> float:
        """How much later this channel is sampled, in steps of 40 ps."""
        return self._deskew_s

    @deskew_s.setter
    def deskew_s(self, seconds: float) -> None:
        self._deskew_s = round(seconds / DESKEW_STEP_S) * DESKEW_STEP_S

    @property
    def attenuation(self) -> float:
        """The external attenuation. Scale and offset are volts in front of it: they follow, the input's gain stays."""
        return self._attenuation

    @attenuation.setter
    def attenuation(self, factor: float) -> None:
        change = factor / self._attenuation
        self._attenuation = factor
        self.scale_v *= change
        self.offset_v *= change

    @property
    def attenuation_db(self) -> float:
        """The external attenuation in decibels of voltage."""
        return 20 * math.log10(self.attenuation)

    @attenuation_db.setter
    def attenuation_db(self, decibels: float) -> None:
        self.attenuation = 10 ** (decibels / 20)

    @property
    def enhancing(self) -> bool:
        """Whether the response is corrected digitally: at full bandwidth only."""
        return self.enhancement_forced or (self.enhanced == "AUTO" and self.bandwidth_hz == BANDWIDTH_HZ)

    @property
    def vertical(self) -> Vertical:
        """The settings that matter to the codes."""
        return Vertical(
            self.scale_v,
            self.offset_v,
            self.position_div,
            self.inverted,
            self.attenuation,
            self.bandwidth_hz,
            self._coupling == "GND",
            self._deskew_s,
        )
