"""The virtual optical power meter: a PM100D with a fibre sensor, behind a tap of the laser's output.

Sources of the commands: the package ThorlabsPM100 (its class documentation names each SCPI command), the driver
`thorlabspm100usb.py` of PyMeasure, `Thorlab_PM100D` of qcodes_contrib_drivers. The limits of the sensor are recalled.
"""

import math
from collections.abc import Mapping
from typing import Any

from sim_backends.parameters import power_ratio
from sim_backends.scpi.arguments import boolean, integer, keyword, optional, real
from sim_backends.scpi.commands import Action, Query, Setting
from sim_backends.virtual.instrument import ERROR_QUEUE, VirtualInstrument
from sim_backends.world.world import World

TAP = 0.01  # of the coupler, where the station file does not say
SHORTEST_NM, LONGEST_NM = 800.0, 1700.0
FIRST_NM = 1310.0
MOST_W = 3e-3  # that the sensor measures
LEAST_W = 1e-12  # what it shows in dBm of no light at all
OVER_RANGE = 9.9e37  # infinity, SCPI-99, 7.2.1.4
READING_S = 3e-3  # of one of the readings that are averaged

_END = optional(keyword("MINimum", "MAXimum"))


class VirtualPm100(VirtualInstrument):
    """What a client of the power meter can see, and what it sees of the laser.

    Its photodiode gives a current that grows with the wavelength, and the console divides by what it should be at the
    wavelength that is set: set otherwise than the light is, it shows another power.
    """

    IDENTITY = "Thorlabs,PM100D (simulated),SIM0001,2.8.0"
    COMMANDS = (
        Query("SYSTem:SENSor:IDN?", "sensor"),
        Action("[:SENSe]:CORRection:WAVelength", "set_wavelength", real(SHORTEST_NM, LONGEST_NM)),
        Query("[:SENSe]:CORRection:WAVelength?", "wavelength", _END),
        Setting("[:SENSe]:CORRection[:LOSS[:INPut[:MAGNitude]]]", "loss_db", real(-60, 60)),
        Setting("[:SENSe]:CORRection:COLLect:ZERO:MAGNitude?", "zero_w", real()),
        Setting("[:SENSe]:AVERage[:COUNt]", "averages", integer(1, 3000)),
        Setting("[:SENSe]:POWer[:DC]:RANGe[:UPPer]", "range_w", real(0, MOST_W)),
        Setting("[:SENSe]:POWer[:DC]:RANGe:AUTO", "auto_range", boolean),
        Setting("[:SENSe]:POWer[:DC]:REFerence", "reference_w", real()),
        Setting("[:SENSe]:POWer[:DC]:REFerence:STATe", "delta", boolean),
        Setting("[:SENSe]:POWer[:DC]:UNIT", "unit", keyword("W", "DBM")),
        Action("CONFigure[:SCALar]:POWer", "carry_on"),
        Action("INITiate[:IMMediate]", "carry_on"),
        Action("ABORt", "carry_on"),
        Query("MEASure[:SCALar][:POWer]?", "power"),
        Query("READ?", "power"),
        Query("FETCh?", "power"),
        *ERROR_QUEUE,
    )

    def __init__(self, world: World, section: Mapping[str, Any] | None = None) -> None:
        super().__init__(world, section)
        self._tap = float(self.section.get("tap", TAP))
        self.reset()

    def reset(self) -> None:
        """`*RST`."""
        self._wavelength_nm = FIRST_NM
        self.loss_db = 0.0
        self.averages = 1
        self.range_w = MOST_W
        self.auto_range = True
        self.unit = "W"
        self.reference_w = 0.0
        self.delta = False
        self.zero_w = 0.0

    def sensor(self) -> str:
        """Name, serial number, calibration; photodiode (1), subtype, flags: power, wavelength settable, temperature."""
        return '"S154C","SIM0001","01-Jan-2026",1,2,289'

    def set_wavelength(self, wavelength_nm: float) -> None:
        """The wavelength that is corrected for (nm)."""
        self._wavelength_nm = wavelength_nm

    def wavelength(self, end: str | None) -> float:
        """The wavelength that is corrected for, or the shortest or longest that can be (nm)."""
        ends = {None: self._wavelength_nm, "MINimum": SHORTEST_NM, "MAXimum": LONGEST_NM}
        return ends[end]

    def power(self) -> float:
        """What the sensor sees, as the console shows it; readings have no noise of their own."""
        self.world.clock.advance(READING_S * self.averages)
        light = self.world.laser_light
        shown_w = 0.0
        if light is not None:
            shown_w = light.power_w * self._tap * light.wavelength_nm / self._wavelength_nm
        if shown_w > (MOST_W if self.auto_range else self.range_w):
            return OVER_RANGE
        shown_w *= power_ratio(self.loss_db)
        if self.delta:
            shown_w -= self.reference_w
        return shown_w if self.unit == "W" else 10 * math.log10(max(shown_w, LEAST_W) * 1e3)
