"""What the simulated bench serves in the place of these instruments."""

from collections.abc import Mapping
from typing import Any

from sim_backends.scpi.arguments import integer, real
from sim_backends.scpi.commands import Query, Setting
from sim_backends.virtual import VirtualInstrument
from sim_backends.virtual.instrument import ERROR_QUEUE
from sim_backends.world.world import World

READING_S = 1e-3


class VirtualPm1(VirtualInstrument):
    """The power meter: it sees the part of the laser's light that the station says."""

    IDENTITY = "ACME,PM-1,SIM0001,1.0"
    COMMANDS = (
        Setting("WAVelength", "wavelength_nm", real(800, 1700)),
        Setting("AVERages", "averages", integer(1, 1000)),
        Query("POWer?", "power_w"),
        *ERROR_QUEUE,
    )

    def __init__(self, world: World, section: Mapping[str, Any]) -> None:
        """Behind the tap that `section`, its table of the station file, names."""
        super().__init__(world, section)
        self.reset()

    def reset(self) -> None:
        """`*RST`."""
        self.wavelength_nm = 1310.0
        self.averages = 1

    def power_w(self) -> float:
        """The power at the sensor; the reading takes its time on the bench's own clock."""
        self.world.clock.advance(READING_S * self.averages)
        light = self.world.laser_light
        return 0.0 if light is None else light.power_w * float(self.section["tap"])


class VirtualThermometer(VirtualInstrument):
    """The thermometer: the chip is at 21 degrees for ever."""

    IDENTITY = "ACME,T-1,SIM0001,1.0"
    COMMANDS = (Query("TEMPerature?", "celsius"), *ERROR_QUEUE)

    def celsius(self) -> float:
        """In degrees Celsius."""
        return 21.0
