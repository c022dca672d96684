"""Fibres that are moved by hand: the operator acts, the software asks, waits and records."""

from collections.abc import Mapping

from instruments.driver import Ask, Driver
from instruments.errors import OutOfRange
from instruments.interfaces import PatchPanel
from instruments.sections import PatchPanelSection
from instruments.values import Identity

DRIVER = Driver(
    section=PatchPanelSection,
    open=lambda section, opening: ManualPatchPanel(opening.ask, ports=section.ports),
    sent_anew=("ch?",),
    by_hand=True,
)


class ManualPatchPanel(PatchPanel):
    """Fibres moved by hand."""

    def __init__(self, ask: Ask, *, ports: tuple[int, ...]) -> None:
        """Ask the operator through `ask`; `ports` are the waveguides that have a fibre."""
        self._ask = ask
        self.ports = ports
        self._patching: dict[int, int] = {}

    def identify(self) -> Identity:
        """A panel without a voice."""
        return Identity("", "manual patch panel", "", "")

    def self_test(self) -> None:
        """Nothing that can be tested from here."""

    def asks(self, patching: Mapping[int, int]) -> bool:
        """Whether it differs from the last one confirmed."""
        return dict(patching) != self._patching

    def connect(self, patching: Mapping[int, int]) -> None:
        """Ask for connections that differ from the last ones confirmed; the light is off."""
        for port in patching.values():
            if port not in self.ports:
                raise OutOfRange(f"port {port} has no fibre on the patch panel (ports {list(self.ports)})")
        if self.asks(patching):
            connections = ", ".join(f"port {port} to CH{channel}" for channel, port in sorted(patching.items()))
            self._ask(
                f"The light is off until you press Enter, see at the laser that it is: connect {connections}, and "
                f"nothing else, then press Enter"
            )
            self._patching = dict(patching)

    def settings(self) -> dict[str, str | float]:
        """The connections the operator confirmed."""
        return {f"ch{channel}": port for channel, port in sorted(self._patching.items())}

    def make_safe(self) -> None:
        """Nothing to do: a fibre carries light only while the laser emits."""

    def close(self) -> None:
        """Nothing to release."""
