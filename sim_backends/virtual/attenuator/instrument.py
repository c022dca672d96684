"""The virtual variable optical attenuator, behind booster or amplifier and before the fibre.

Its commands are in the manner of SCPI-99, volume 2 (INPut:ATTenuation), and of no model in particular.
"""

import math
from collections.abc import Mapping
from typing import Any

from sim_backends.scpi.arguments import boolean, real
from sim_backends.scpi.commands import Command, Setting
from sim_backends.virtual.instrument import ERROR_QUEUE, VirtualInstrument
from sim_backends.world.world import World

MOST_DB = 60.0


class VirtualAttenuator(VirtualInstrument):
    """What a client of the attenuator can see, and what it does to the light."""

    IDENTITY = "labctl,optical attenuator (simulated),SIM0001,1.0"
    COMMANDS = (
        Setting("INPut:ATTenuation", "attenuation_db", real(0, MOST_DB)),
        Setting("OUTPut[:STATe]", "on", boolean),
        *ERROR_QUEUE,
    )

    def __init__(self, world: World, section: Mapping[str, Any] | None = None) -> None:
        super().__init__(world, section)
        self.reset()

    def reset(self) -> None:
        """`*RST`: shut."""
        self.on, self.attenuation_db = False, 0.0
        self._attenuate()

    def changed(self, _command: Command) -> None:
        """Light follows every setting."""
        self._attenuate()

    def _attenuate(self) -> None:
        self.world.attenuate(self.attenuation_db if self.on else math.inf)
