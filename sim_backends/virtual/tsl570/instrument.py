"""The virtual tunable laser TSL-570: dark while it tunes, its numbers in other units in its other command set.

Sources of the commands: `qmi/instruments/santec/tsl_570.py` of QMI (legacy command set, messages end with CR, `*OPC?`
answers at once whether it rests), `pymeasure/instruments/santec/tsl570.py` (SCPI command set, metres, shutter). Not
simulated: light that moves while it sweeps.
"""

import math
from collections.abc import Mapping
from typing import Any

from sim_backends.scpi.arguments import boolean, integer, real
from sim_backends.scpi.commands import Action, Command, Query, Setting
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.instrument import ERROR_QUEUE, VirtualInstrument
from sim_backends.world.signals import Emission
from sim_backends.world.world import World

SHORTEST_NM, LONGEST_NM = 1500.0, 1630.0
LEAST_DBM, MOST_DBM = -15.0, 13.0
DARK_DBM = -50.0  # what the power monitor shows without light; recalled
FINE_NM = 0.5e-3  # of a unit of fine tuning, a guess: public drivers give its range, -100 to 100, and no unit
POLL_S = 0.1  # what a client lets pass between two questions whether it rests
LEGACY, SCPI = 0, 1
DBM, MW = 0, 1


class VirtualTsl570(VirtualInstrument):
    """What a client of the laser can see, and the light that comes out."""

    IDENTITY = "SANTEC,TSL-570,SIM00001,0001.000.0001"
    TERMINATOR = b"\r"
    COMMANDS = (
        Setting("SYSTem:COMMunicate:CODe", "code", integer(LEGACY, SCPI)),
        Setting("WAVelength", "wavelength", real()),
        Query("WAVelength:MINimum?", "shortest"),
        Query("WAVelength:MAXimum?", "longest"),
        Setting("WAVelength:UNIT", "wavelength_unit", integer(0, 1), effect=False),
        Setting("WAVelength:OFFSet", "offset_nm", real(-0.1, 0.1)),
        Setting("WAVelength:FINe", "fine", real(-100, 100)),
        Action("WAVelength:FINetuning:DISable", "end_fine_tuning"),
        Setting("WAVelength:SWEep[:STATe]", "sweeps", integer(0, 1), effect=False),
        Setting("COHCtrl", "coherence_control", boolean, effect=False),
        Setting("AM:STATe", "modulated", boolean, effect=False),
        Setting("POWer[:LEVel]", "power", real()),
        Query("POWer:ACTual?", "actual_power"),
        Setting("POWer:UNIT", "power_unit", integer(DBM, MW)),
        Setting("POWer:STATe", "output", boolean),
        Setting("POWer:SHUTter", "shutter_closed", boolean),
        Setting("POWer:ATTenuation:AUTo", "auto_attenuation", boolean, effect=False),
        Query("SYSTem:ALERt?", "alert"),
        *ERROR_QUEUE,
    )

    def __init__(self, world: World, section: Mapping[str, Any] | None = None) -> None:
        super().__init__(world, section)
        self.code = LEGACY
        self.reset()

    def reset(self) -> None:
        """`*RST`: dark, first wavelength and power; the command set stays."""
        self._settled_s = 0.0
        self._wavelength_nm = 1550.0
        self._power_dbm = 10.0
        self.wavelength_unit, self.power_unit = 0, DBM
        self.sweeps = 0
        self.offset_nm = self.fine = 0.0
        self.coherence_control = self.modulated = self.output = False
        self.shutter_closed = self.auto_attenuation = True
        self._emit()

    def changed(self, _command: Command) -> None:
        """Light follows every setting."""
        self._emit()

    def operations_complete(self) -> int:
        """`*OPC?`: whether it rests; it does not wait."""
        self.world.clock.advance(POLL_S)
        return int(self.world.clock.now >= self._settled_s)

    @property
    def wavelength(self) -> float:
        """In nm, or in metres in the SCPI command set."""
        return self._shown(self._wavelength_nm)

    @wavelength.setter
    def wavelength(self, value: float) -> None:
        wanted_nm = value * 1e9 if self.code == SCPI else value
        if not SHORTEST_NM <= wanted_nm <= LONGEST_NM:
            raise ScpiError(-222, f"{value:g}")
        if wanted_nm != self._wavelength_nm:
            self._wavelength_nm = wanted_nm
            self._settled_s = self.world.clock.now + self.world.parameters.laser_tuning_s

    def shortest(self) -> float:
        """Where its tuning begins."""
        return self._shown(SHORTEST_NM)

    def longest(self) -> float:
        """Where its tuning ends."""
        return self._shown(LONGEST_NM)

    def end_fine_tuning(self) -> None:
        """Back to the wavelength that was set."""
        self.fine = 0.0

    @property
    def power(self) -> float:
        """What is asked of it, in dBm or mW."""
        return self._in_unit(self._power_dbm)

    @power.setter
    def power(self, value: float) -> None:
        wanted_dbm = value if self.power_unit == DBM else 10 * math.log10(value) if value > 0 else -math.inf
        if not LEAST_DBM <= wanted_dbm <= MOST_DBM:
            raise ScpiError(-222, f"{value:g}")
        self._power_dbm = wanted_dbm

    def actual_power(self) -> float:
        """What its monitor sees, in dBm or mW."""
        return self._in_unit(DARK_DBM if self.world.laser_light is None else self._power_dbm)

    def alert(self) -> str:
        """What is wrong with it: nothing."""
        return "No alerts."

    def _shown(self, nm: float) -> float:
        return nm * 1e-9 if self.code == SCPI else nm

    def _in_unit(self, dbm: float) -> float:
        return dbm if self.power_unit == DBM else 10 ** (dbm / 10)

    def _emit(self) -> None:
        lit = self.output and not self.shutter_closed
        wavelength_nm = self._wavelength_nm + self.offset_nm + FINE_NM * self.fine
        light = Emission(wavelength_nm, 1e-3 * 10 ** (self._power_dbm / 10)) if lit else None
        self.world.emit(light, lit_from_s=self._settled_s)
