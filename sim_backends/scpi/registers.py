"""The status registers of SCPI: what is the case now, what has happened, and what of it the status byte tells.

Source: SCPI-99, volume 1, chapter 9, and volume 2, chapter 20 (`STATus`).
"""

from collections.abc import Callable
from dataclasses import dataclass

from sim_backends.scpi.arguments import Integer, integer
from sim_backends.scpi.commands import Action, Command, Query, Setting
from sim_backends.scpi.status import Status

EVERY_BIT = 0x7FFF
QUESTIONABLE_SUMMARY, OPERATION_SUMMARY = 0x08, 0x80  # bits of the status byte

FREQUENCY = 0x20  # of the questionable register: the frequency is
WAITING_FOR_TRIGGER = 0x20  # of the operation register


class Bits(Integer):
    """Bits of a register; the highest one is never set."""

    def parse(self, argument: str | memoryview) -> int:
        """Read a number; -222 outside 16 bits."""
        return super().parse(argument) & EVERY_BIT


_BITS = Bits(maximum=0xFFFF)

STATUS_COMMANDS: tuple[Command, ...] = (
    Action("STATus:PRESet", "status.preset"),
    *(
        command
        for node in ("OPERation", "QUEStionable")
        for command in (
            Query(f"STATus:{node}[:EVENt]?", f"status.{node.lower()}.read"),
            Setting(f"STATus:{node}:CONDition?", f"status.{node.lower()}.condition", integer()),
            Setting(f"STATus:{node}:ENABle", f"status.{node.lower()}.enabled", _BITS),
            Setting(f"STATus:{node}:PTRansition", f"status.{node.lower()}.rising", _BITS),
            Setting(f"STATus:{node}:NTRansition", f"status.{node.lower()}.falling", _BITS),
        )
    ),
)


@dataclass
class Register:
    """One condition, the filters of its transitions, and its events.

    Attributes:
        ask: what is the case now, as bits.
        enabled: events that the status byte tells.
        rising, falling: bits whose beginning, or whose end, is an event.
    """

    ask: Callable[[], int]
    enabled: int = 0
    rising: int = EVERY_BIT
    falling: int = 0
    _events: int = 0
    _last: int = 0

    @property
    def condition(self) -> int:
        """What is the case now."""
        return self.ask()

    @property
    def told(self) -> bool:
        """Whether an event has happened that the status byte tells."""
        self.look()
        return bool(self._events & self.enabled)

    def look(self) -> None:
        """What has changed since the last look becomes an event."""
        now = self.ask()
        self._events |= now & ~self._last & self.rising | ~now & self._last & self.falling
        self._last = now

    def read(self) -> int:
        """The events, which are cleared."""
        self.look()
        events, self._events = self._events, 0
        return events

    def preset(self) -> None:
        """No event is told, every beginning is one."""
        self.enabled, self.rising, self.falling = 0, EVERY_BIT, 0


class RegisterStatus(Status):
    """A status with the operation and the questionable register of SCPI."""

    def __init__(self, operation: Callable[[], int], questionable: Callable[[], int]) -> None:
        super().__init__()
        self.operation = Register(operation)
        self.questionable = Register(questionable)

    @property
    def registers(self) -> int:
        """The bits of the status byte that the registers set."""
        told = OPERATION_SUMMARY if self.operation.told else 0
        return told | (QUESTIONABLE_SUMMARY if self.questionable.told else 0)

    def look(self) -> None:
        """What has changed since the last look becomes an event."""
        self.operation.look()
        self.questionable.look()

    def preset(self) -> None:
        """`STATus:PRESet`."""
        self.operation.preset()
        self.questionable.preset()

    def clear(self) -> None:
        """`*CLS`: forget these events as well."""
        super().clear()
        self.operation.read()
        self.questionable.read()
