"""The virtual optical amplifier: in the place of the booster behind the modulator, with constant output power.

Its commands are nobody's in particular: real amplifiers have no common ones. See `sim_backends.optics.launch` for what
of the physics is left out.
"""

import math
from collections.abc import Mapping
from typing import Any

from sim_backends.parameters import power_ratio
from sim_backends.scpi.arguments import boolean, real
from sim_backends.scpi.commands import Command, Query, Setting
from sim_backends.virtual.instrument import ERROR_QUEUE, VirtualInstrument
from sim_backends.world.world import World

LEAST_DBM, MOST_DBM = 0.0, 27.0
DARK_DBM = -60.0  # what its monitor shows without light


class VirtualAmplifier(VirtualInstrument):
    """What a client of the amplifier can see, and what it does to the light."""

    IDENTITY = "labctl,optical amplifier (simulated),SIM0001,1.0"
    COMMANDS = (
        Setting("POWer:LEVel", "power_dbm", real(LEAST_DBM, MOST_DBM)),
        Query("POWer:OUTPut?", "output_dbm"),
        Setting("OUTPut[:STATe]", "on", boolean),
        *ERROR_QUEUE,
    )

    def __init__(self, world: World, section: Mapping[str, Any] | None = None) -> None:
        super().__init__(world, section)
        self.reset()

    def reset(self) -> None:
        """`*RST`: off."""
        self.on, self.power_dbm = False, 10.0
        self._amplify()

    def changed(self, _command: Command) -> None:
        """Light follows every setting."""
        self._amplify()

    def output_dbm(self) -> float:
        """What its monitor sees come out."""
        power_w = self.world.amplified_power_w
        return 10 * math.log10(power_w * 1e3) if power_w > 0 else DARK_DBM

    def _amplify(self) -> None:
        self.world.amplify(1e-3 * power_ratio(self.power_dbm) if self.on else 0.0)
