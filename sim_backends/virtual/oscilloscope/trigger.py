"""The A trigger of the virtual oscilloscope: an edge, and when it comes.

Source: instrument facts 2.6. Numbers that are only recalled are module constants. The trigger's coupling is kept but
changes nothing: the edges on this bench are tens of picoseconds long and pass every one of them.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sim_backends.scpi.arguments import keyword, real
from sim_backends.scpi.commands import Setting
from sim_backends.virtual.oscilloscope.vertical import CHANNELS
from sim_backends.world.signals import AUX, TriggerCondition
from sim_backends.world.world import World

TRIGGER_LIMIT_V = 5.0  # recalled
MAINS_HZ = 49.9917  # LINE triggers at the mains' zero crossings, which keep no step with anything on the bench
LINE = -1
TRIGGER_SOURCES = {"AUXiliary": AUX, **CHANNELS, "LINE": LINE}

_SLOPE = keyword("RISe", "FALL", "EITher")
_LEVEL = real(-TRIGGER_LIMIT_V, TRIGGER_LIMIT_V, ECL=-1.3, TTL=1.4)

TRIGGER_COMMANDS = (
    Setting("TRIGger:A:TYPe", "trigger.type", keyword("EDGE"), effect=False),
    Setting("TRIGger:A:MODe", "trigger.mode", keyword("AUTO", "NORMal")),
    Setting("TRIGger:A:EDGE:SOUrce", "trigger.source", keyword(*TRIGGER_SOURCES)),
    Setting("TRIGger:A:EDGE:SLOpe", "trigger.present.slope", _SLOPE),
    Setting("TRIGger:A:EDGE:SLOpe:AUX", "trigger.auxiliary.slope", _SLOPE),
    Setting("TRIGger:A:EDGE:SLOpe:CH#", "trigger.inputs#.slope", _SLOPE),
    Setting("TRIGger:A:EDGE:COUPling", "trigger.coupling", keyword("DC", "AC", "HFRej", "LFRej", "NOISErej")),
    Setting("TRIGger:A:LEVel", "trigger.level_v", _LEVEL),
    Setting("TRIGger:A:LEVel:CH#", "trigger.inputs#.level_v", _LEVEL),
    Setting("TRIGger:AUXLevel", "trigger.auxiliary.level_v", _LEVEL),
    Setting(
        "TRIGger:LVLSrcpreference", "trigger.level_preference", keyword("SRCDependent", "SRCIndependent"), effect=False
    ),
    Setting("TRIGger:A:HOLDoff:BY", "trigger.holdoff_by", keyword("TIMe", "DEFAult", "RANDom", "AUTO")),
    Setting("TRIGger:A:HOLDoff:TIMe", "trigger.holdoff_s", real(0, 10)),
)


@dataclass
class TriggerInput:
    """Level and slope of one trigger source."""

    level_v: float = 0.0
    slope: str = "RISe"


@dataclass
class Trigger:
    """The A trigger: an edge on AUX or a channel, or the mains."""

    type: str = "EDGE"
    mode: str = "AUTO"
    source: str = "CH1"
    coupling: str = "DC"
    level_preference: str = "SRCIndependent"
    holdoff_by: str = "DEFAult"
    holdoff_s: float = 0.0
    inputs: dict[int, TriggerInput] = field(
        default_factory=lambda: {number: TriggerInput() for number in TRIGGER_SOURCES.values()}
    )

    @property
    def auxiliary(self) -> TriggerInput:
        """The AUX input."""
        return self.inputs[AUX]

    @property
    def present(self) -> TriggerInput:
        """The input that `source` names."""
        return self.inputs[TRIGGER_SOURCES[self.source]]

    @property
    def level_v(self) -> float:
        """Level of the channel that is the source; AUX has a command of its own, this one then means channel 1."""
        return self._levelled.level_v

    @level_v.setter
    def level_v(self, volts: float) -> None:
        self._levelled.level_v = volts

    @property
    def _levelled(self) -> TriggerInput:
        return self.inputs[max(TRIGGER_SOURCES[self.source], 1)]

    def spacing(self, least_s: float) -> float:
        """Least time between two triggers (s): the hold-off, or `least_s`, what an acquisition takes."""
        return max(self.holdoff_s if self.holdoff_by == "TIMe" else 0.0, least_s)

    @property
    def condition(self) -> TriggerCondition | None:
        """The edge that triggers; None for either edge and for the mains, which `upcoming` looks up."""
        source, present = TRIGGER_SOURCES[self.source], self.present
        if source == LINE or present.slope == "EITher":
            return None
        return TriggerCondition(source, present.level_v, rising=present.slope == "RISe")

    def upcoming(self, world: World, count: int, spacing_s: float, after_s: float) -> NDArray[np.float64] | None:
        """Times (s) of the next `count` triggers by the mains or by either edge, fewer if fewer will come; or None."""
        source = TRIGGER_SOURCES[self.source]
        if source == LINE:
            first, every = np.ceil(after_s * MAINS_HZ), max(1.0, np.ceil(spacing_s * MAINS_HZ))
            return np.asarray((first + every * np.arange(count)) / MAINS_HZ)
        conditions = [TriggerCondition(source, self.present.level_v, rising=rising) for rising in (True, False)]
        times: list[float] = []
        while len(times) < count:
            nearest = [world.next_triggers(condition, 1, after_s=after_s) for condition in conditions]
            candidates = [float(found[0]) for found in nearest if found is not None]
            if not candidates:
                break
            times.append(min(candidates))
            after_s = times[-1] + max(spacing_s, 1e-12)
        return np.array(times) if times else None
