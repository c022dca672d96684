"""AUTOSet of the virtual oscilloscope: vertical, horizontal and trigger settings that show what is there.

Source: tm_devices 3.7, descriptions of the AUTOSet commands. How the real routine searches is not known; this one looks
at every channel that is on, brings it to 6 divisions around the middle, shows some cycles of the lowest channel if it
has any, and triggers on its middle.
"""

from contextlib import suppress
from typing import Protocol

from sim_backends.scpi.arguments import keyword
from sim_backends.scpi.commands import Action
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.dpo72504dx.measurements import Waveform
from sim_backends.virtual.dpo72504dx.setups import Setups
from sim_backends.virtual.oscilloscope.horizontal import DIVISIONS
from sim_backends.virtual.oscilloscope.vertical import CHANNELS, HIGHEST_SCALE_V, LOWEST_SCALE_V

SHOWN_DIVISIONS = 6
CYCLES = 4
LOOKS = 3
"""The first look may find a signal far from the middle, the next ones refine."""

AUTOSET_COMMANDS = (Action("AUTOSet", "autoset.begin", keyword("EXECute", "UNDo", "VFields", "VIDeo", "VLines")),)


class Oscilloscope(Protocol):
    """What the routine needs."""

    setups: Setups

    def shown(self, source: str) -> bool:
        """Whether a channel is on."""

    def measured_waveform(self, source: str) -> Waveform:
        """What was last acquired of a channel."""

    def obey(self, text: str) -> None:
        """Execute commands."""


class Autoset:
    """The routine, and how the settings were before it."""

    def __init__(self, oscilloscope: Oscilloscope) -> None:
        self._oscilloscope = oscilloscope
        self._before: str | None = None

    def begin(self, word: str) -> None:
        """`AUTOSet EXECute` and `UNDo`; -221 for video, and for UNDo without an autoset."""
        scope = self._oscilloscope
        if word == "UNDo":
            if self._before is None:
                raise ScpiError(-221, "there is no autoset to undo")
            scope.obey(self._before)
        elif word == "EXECute":
            self._before = scope.setups.learn()
            self._search()
        else:
            raise ScpiError(-221, "video signals are not simulated")

    def _search(self) -> None:
        scope = self._oscilloscope
        channels = [name for name in CHANNELS if scope.shown(name)] or ["CH1"]
        scope.obey(f":SELect:{channels[0]} ON;:HORizontal:FASTframe:STATE OFF;:ACQuire:MODe SAMple")
        scope.obey(":TRIGger:A:MODe AUTO;:TRIGger:A:EDGE:SLOpe RISe;:ACQuire:STOPAfter SEQuence")
        for name in channels:
            scope.obey(f":{name}:SCAle {HIGHEST_SCALE_V};OFFSet 0;POSition 0")
        for _ in range(LOOKS):
            for name, waveform in self._look(channels).items():
                low, high = float(waveform.points.min()), float(waveform.points.max())
                scale = min(max((high - low) / SHOWN_DIVISIONS, LOWEST_SCALE_V), HIGHEST_SCALE_V)
                scope.obey(f":{name}:OFFSet {(low + high) / 2:.6e};SCAle {scale:.6e}")
        first = self._look(channels[:1])[channels[0]]
        with suppress(ScpiError):  # without cycles the time base stays
            scope.obey(f":HORizontal:MODE AUTO;:HORizontal:MODE:SCAle {CYCLES * first.period() / DIVISIONS:.6e}")
        middle = sum(first.levels) / 2
        scope.obey(f":TRIGger:A:EDGE:SOUrce {channels[0]};:TRIGger:A:LEVel:{channels[0]} {middle:.6e}")
        scope.obey(":ACQuire:STOPAfter RUNSTop;STATE RUN")

    def _look(self, channels: list[str]) -> dict[str, Waveform]:
        """An acquisition; its trigger comes or is done without."""
        self._oscilloscope.obey(":ACQuire:STATE RUN")
        return {name: self._oscilloscope.measured_waveform(name) for name in channels}
