"""The virtual optical switch between the chip's ports and the oscilloscope's channels.

`ROUTe:CLOSe (@<channel>!<port>)` in the manner of SCPI-99, volume 2, chapter 17 (SIGNal ROUTing): the question needs a
list, too, and answers 1 or 0 for each of it, as the HP E1468A does.
"""

from sim_backends.scpi.arguments import channels
from sim_backends.scpi.commands import Action, Query
from sim_backends.scpi.status import ScpiError
from sim_backends.virtual.instrument import ERROR_QUEUE, VirtualInstrument
from sim_backends.world.world import World

CHANNELS = 4
SWITCHING_S = 10e-3  # recalled: mechanical and MEMS switches take 1 to 20 ms

_CROSSPOINTS = channels(2)


class VirtualFibreSwitch(VirtualInstrument):
    """What a client of the switch can see, and which port lights which detector. Port 0 goes past the chip."""

    IDENTITY = "labctl,fibre switch (simulated),SIM0001,1.0"
    COMMANDS = (
        Action("ROUTe:CLOSe", "connect", _CROSSPOINTS),
        Query("ROUTe:CLOSe?", "connected", _CROSSPOINTS),
        Action("ROUTe:OPEN", "disconnect", channels(1)),
        Action("ROUTe:OPEN:ALL", "reset"),
        *ERROR_QUEUE,
    )

    def __init__(self, world: World) -> None:
        super().__init__(world)
        self._ports: dict[int, int] = {}

    def reset(self) -> None:
        """`*RST`, `ROUTe:OPEN:ALL`: connect nothing."""
        self._switch({})

    def connect(self, crosspoints: tuple[tuple[int, int], ...]) -> None:
        """Put ports on channels, in place of what was there; -222 for one that is not there, -221 for a port twice."""
        wanted = dict(self._ports)
        self._require(crosspoints)
        wanted.update(crosspoints)
        if len(set(wanted.values())) < len(wanted):
            raise ScpiError(-221, "a port can be on one channel only")
        self._switch(wanted)

    def disconnect(self, numbers: tuple[tuple[int], ...]) -> None:
        """Take the ports off some channels; -222 for one that is not there."""
        for (channel,) in numbers:
            if not 1 <= channel <= CHANNELS:
                raise ScpiError(-222, f"(@{channel})")
        self._switch({channel: port for channel, port in self._ports.items() if (channel,) not in numbers})

    def connected(self, crosspoints: tuple[tuple[int, int], ...]) -> str:
        """1 for each that is connected, 0 for the others; -222 for one that is not there."""
        self._require(crosspoints)
        return ",".join(str(int(self._ports.get(channel) == port)) for channel, port in crosspoints)

    def _require(self, crosspoints: tuple[tuple[int, int], ...]) -> None:
        for channel, port in crosspoints:
            if not 1 <= channel <= CHANNELS or port > self.world.parameters.chip_ports:
                raise ScpiError(-222, f"(@{channel}!{port})")

    def _switch(self, wanted: dict[int, int]) -> None:
        if wanted != self._ports:
            self._ports = wanted
            self.world.patch(wanted)
            self.world.clock.advance(SWITCHING_S)
