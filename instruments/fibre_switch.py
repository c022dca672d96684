"""An optical matrix switch with SCPI routing commands: `ROUTe:CLOSe (@channel!port)`, `ROUTe:OPEN:ALL`."""

import re
from collections.abc import Mapping

from instruments.driver import Driver
from instruments.errors import InstrumentError, OutOfRange, excerpt
from instruments.interfaces import PatchPanel
from instruments.readback import SettingsKept
from instruments.sections import PatchPanelSection, Timeout
from instruments.values import Change, Examination, Identity
from instruments.visa import VisaLink


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
        self._kept = SettingsKept(link)
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
            self._link.query("ROUTe:CLOSe?")

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
        wanted = ",".join(f"{channel}!{port}" for channel, port in sorted(patching.items()))
        (routed,) = self._kept.keep(["ROUTe:CLOSe?"])
        if routed != f"(@{wanted})":
            raise InstrumentError(f"patch_panel: routes are {excerpt(routed)}, wanted (@{wanted}): check the switch")

    def changes(self) -> tuple[Change, ...]:
        """The closed routes."""
        return self._kept.changes()

    def settings(self) -> dict[str, str | float]:
        """The closed routes."""
        return {"routes": self._link.query("ROUTe:CLOSe?")}

    def make_safe(self) -> None:
        """Nothing to do: a route carries light only while the laser emits."""

    def close(self) -> None:
        """Close the link."""
        self._link.close()
