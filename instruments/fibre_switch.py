"""An optical matrix switch with SCPI routing commands: `ROUTe:CLOSe (@channel!port)`, `ROUTe:OPEN:ALL`.

`ROUTe:CLOSe? (@channel!port,...)` answers 1 or 0 for each of a list (SCPI-99, volume 2, chapter 17): switches such as
the HP E1468A refuse the question without one.
"""

import re
from collections.abc import Mapping

from instruments.driver import Driver
from instruments.errors import InstrumentError, OutOfRange, excerpt
from instruments.interfaces import PatchPanel
from instruments.sections import PatchPanelSection, Timeout
from instruments.values import Change, Examination, Identity
from instruments.visa import VisaLink

CHANNELS = range(1, 5)
"""Of the oscilloscope."""


class FibreSwitchSection(PatchPanelSection):
    """What connects the chip to the oscilloscope: `ports` are the waveguides that are wired, 0 the fibre before it."""

    timeout: Timeout = 5.0


DRIVER = Driver(
    section=FibreSwitchSection,
    open=lambda section, opening: ScpiFibreSwitch(
        VisaLink(opening.address, name="patch_panel", timeout_s=section.timeout, transcript=opening.transcript),
        ports=section.ports,
    ),
    identity=re.compile("switch", re.IGNORECASE),
    sent_anew=("routes",),
)


class ScpiFibreSwitch(PatchPanel):
    """Connects ports of the chip to channels of the oscilloscope without a hand on the bench."""

    def __init__(self, link: VisaLink, *, ports: tuple[int, ...]) -> None:
        """Drive the switch behind `link`, which carries `ports`."""
        self._link = link
        self._crosspoints = [f"{channel}!{port}" for channel in CHANNELS for port in ports]
        self._connected: str | None = None
        self.ports = ports

    def identify(self) -> Identity:
        """`*IDN?`."""
        return Identity.parse(self._link.query("*IDN?"))

    def examine(self) -> Examination:
        """The error queue."""
        return Examination(errors=tuple(self._link.errors()))

    def self_test(self) -> None:
        """Read the error queue; the switch moves no light by itself."""
        with self._link.checked():
            self._routes()

    def connect(self, patching: Mapping[int, int]) -> None:
        """Open every route, close the wanted ones, and compare with the read-back."""
        for port in patching.values():
            if port not in self.ports:
                raise OutOfRange(f"port {port} is not wired to the fibre switch (ports {list(self.ports)})")
        with self._link.checked():
            self._link.write("ROUTe:OPEN:ALL")
            for channel, port in patching.items():
                self._link.write(f"ROUTe:CLOSe (@{channel}!{port})")
            self._link.query("*OPC?")
        wanted = f"(@{','.join(f'{channel}!{port}' for channel, port in sorted(patching.items()))})"
        self._connected = self._routes()
        if self._connected != wanted:
            raise InstrumentError(f"patch_panel: routes are {self._connected}, wanted {wanted}: check the switch")

    def changes(self) -> tuple[Change, ...]:
        """The closed routes."""
        then = self._connected
        if then is None or (now := self._routes()) == then:
            return ()
        return (Change("routes", then, now),)

    def settings(self) -> dict[str, str | float]:
        """The closed routes."""
        return {"routes": self._routes()}

    def make_safe(self) -> None:
        """Nothing to do: a route carries light only while the laser emits."""

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _routes(self) -> str:
        """The closed ones of the channels and ports that are wired, as a channel list; any other answer as it came."""
        answer = self._link.query(f"ROUTe:CLOSe? (@{','.join(self._crosspoints)})")
        closed = answer.split(",")
        if len(closed) != len(self._crosspoints) or not {"0", "1"}.issuperset(closed):
            return excerpt(answer)
        return f"(@{','.join(name for name, one in zip(self._crosspoints, closed, strict=True) if one == '1')})"
