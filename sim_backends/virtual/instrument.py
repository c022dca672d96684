"""What every virtual instrument is: a table of commands, IEEE 488.2 status, and the execution of messages."""

import logging
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, ClassVar, Protocol

from sim_backends.scpi.arguments import integer
from sim_backends.scpi.commands import Action, Command, CommandTable, Query, Setting, reply_header
from sim_backends.scpi.family import Family
from sim_backends.scpi.messages import Chunk, Malformed, Message, Unit
from sim_backends.scpi.status import NotSimulated, ScpiError, Status
from sim_backends.world.receivers import CardFull
from sim_backends.world.signals import OutOfMemory
from sim_backends.world.world import World

_logger = logging.getLogger(__name__)

Execution = Generator[list[Chunk] | None, None, list[Chunk]]

COMMON = (
    Query("*IDN?", "identity"),
    Query("*OPT?", "installed_options"),
    Query("*TST?", "self_test"),
    Query("*ESR?", "status.read_events"),
    Setting("*ESE", "status.event_mask", integer(0, 255)),
    Setting("*SRE", "status.service_mask", integer(0, 255)),
    Query("*STB?", "read_status_byte"),
    Query("*OPC?", "operations_complete", waits="pending"),
    Action("*OPC", "note_completion"),
    Action("*WAI", "carry_on", waits="pending"),
    Action("*CLS", "clear_status"),
    Action("*RST", "reset"),
    Action("*TRG", "bus_trigger"),
)

ERROR_QUEUE = (
    Query("SYSTem:ERRor[:NEXT]?", "status.next_text"),
    Query("SYSTem:ERRor:COUNt?", "status.count"),
    Query("SYSTem:ERRor:ALL?", "status.all_texts"),
    Query("SYSTem:ERRor:CODE[:NEXT]?", "status.next_code"),
    Query("SYSTem:ERRor:CODE:ALL?", "status.all_codes"),
)


class Connected(Protocol):
    """A virtual instrument as one of its clients has it; the methods are those of `VirtualInstrument`."""

    def run(self, message: Message) -> Execution: ...  # noqa: D102
    def connection(self) -> AbstractContextManager["Connected"]: ...  # noqa: D102
    def listens(self, begun: bytes) -> bool: ...  # noqa: D102
    def clear(self) -> None: ...  # noqa: D102
    def status_byte(self) -> int: ...  # noqa: D102


class VirtualInstrument:
    """One instrument as its clients see it.

    A model adds `COMMANDS` and the attributes and methods they name. Nothing a client sends raises: what a command
    refuses is queued as the model's error, leaves the state as it was, and the rest of the message goes on. A header
    that the model's `FAMILY` has and its commands have not is an error with a text of its own, and a line in the log.

    Args:
        world: Where its light comes from and goes to.
        section: What the station file says of it, as JSON has it; a model that is plugged in may heed it.
    """

    COMMANDS: ClassVar[tuple[Command, ...]] = ()
    SUFFIXES: ClassVar[Mapping[str, int]] = {}
    DEFAULT_SUFFIX: ClassVar[int | None] = 1
    IDENTITY: ClassVar[str] = ""
    OPTIONS: ClassVar[str] = "0"
    FAMILY: ClassVar[Family | None] = None
    TERMINATOR: ClassVar[bytes] = b"\n"  # of messages and replies on a raw socket
    _TABLE: ClassVar[CommandTable]

    def __init_subclass__(cls) -> None:
        """Index the model's table of commands."""
        super().__init_subclass__()
        cls._TABLE = CommandTable(COMMON + cls.COMMANDS, cls.SUFFIXES, cls.DEFAULT_SUFFIX, cls.FAMILY)

    def __init__(self, world: World, section: Mapping[str, Any] | None = None) -> None:
        self.world = world
        self.section = section or {}
        self.status = Status()
        self.headers = False  # replies begin with the header of their query
        self.verbose = False  # replies use long words
        self._completion_asked = False
        self._replying = False

    @classmethod
    def lacks(cls) -> Iterator[tuple[str, bool]]:
        """Headers of the model's family that it does not simulate, and whether the query is meant."""
        return cls._TABLE.missing()

    def run(self, message: Message) -> Execution:
        """Execute `message`; returns its reply as the chunks to send, [] for none.

        Yields None while a command must wait (`*OPC?`, `*WAI`). A reply without end comes in parts: each is yielded, []
        while there is none.
        """
        reply: list[Chunk] = []
        path = ""
        for unit in message.units:
            self._notice_completion()
            try:
                if isinstance(unit, Malformed):
                    raise ScpiError(unit.code)
                command, suffixes, path = self._TABLE.find(path, unit.header, unit.query)
                self.prepare(command, query=unit.query)
                while True:
                    while command.waits and command.waits(self)():
                        yield [] if command.endless else None
                    self._replying = bool(reply)
                    part = self._execute(command, suffixes, unit)
                    if not (command.endless and part):
                        break
                    yield _joined(reply, part)
                    reply = []
            except ScpiError as error:
                if isinstance(error, NotSimulated):
                    _logger.warning("%s: %s", type(self).__name__, error.detail)
                part = self.refused(unit, error)
            except MemoryError as error:
                part = self.refused(unit, _out_of_memory(error))
            reply = _joined(reply, part)
        return reply

    def connection(self) -> AbstractContextManager["Connected"]:
        """The instrument as one client has it, as long as the client is there: as all have it."""
        return nullcontext(self)

    def listens(self, begun: bytes) -> bool:
        """Whether it receives the rest of a message that has begun with `begun`: always."""
        return True

    def clear(self) -> None:
        """Device clear: forget a pending `*OPC`; status and settings stay, messages under way are their owner's."""
        self._completion_asked = False

    def status_byte(self) -> int:
        """The status byte as a serial poll reads it."""
        self._notice_completion()
        return self.status.byte()

    # --- what a model may say otherwise

    def pending(self) -> bool:
        """Whether an overlapping operation is still under way."""
        return False

    def prepare(self, command: Command, *, query: bool) -> None:
        """`command` is about to be executed, as soon as it need not wait."""

    def changed(self, command: Command) -> None:
        """`command` was executed (perhaps it changed nothing)."""

    def reset(self) -> None:
        """`*RST`."""

    def bus_trigger(self) -> None:
        """`*TRG`."""

    def refused(self, unit: Unit, error: ScpiError) -> list[Chunk]:
        """`unit` was refused: queue the error; a line-oriented instrument answers with it."""
        self.status.report(error)
        return []

    # --- common commands

    def identity(self) -> str:
        """`*IDN?`."""
        return self.IDENTITY

    def installed_options(self) -> str:
        """`*OPT?`."""
        return self.OPTIONS

    def self_test(self) -> int:
        """`*TST?`: 0, passed."""
        return 0

    def read_status_byte(self) -> int:
        """`*STB?`."""
        return self.status.byte(message_available=self._replying)

    def operations_complete(self) -> int:
        """`*OPC?`: 1, once nothing is pending."""
        return 1

    def note_completion(self) -> None:
        """`*OPC`: set the event bit once nothing is pending."""
        self._completion_asked = True

    def carry_on(self) -> None:
        """`*WAI`: nothing but the wait itself."""

    def clear_status(self) -> None:
        """`*CLS`."""
        self._completion_asked = False
        self.status.clear()

    # --- execution

    def _notice_completion(self) -> None:
        try:
            completed = self._completion_asked and not self.pending()
        except MemoryError as error:
            self.status.report(_out_of_memory(error))
            completed = True
        if completed:
            self._completion_asked = False
            self.status.complete()

    def _execute(self, command: Command, suffixes: Sequence[int], unit: Unit) -> list[Chunk]:
        if not unit.query:
            reply = command.execute(self, suffixes, unit.arguments)
            self.changed(command)
            return reply
        reply = command.answer(self, suffixes, unit.arguments)
        header = reply_header(command, suffixes, verbose=self.verbose) if self.headers and not command.labelled else ""
        return [header.encode() + b" ", *reply] if header and reply else reply


def _out_of_memory(error: MemoryError) -> ScpiError:
    """What an instrument says of it; of a graphics card, which no instrument has, it says nothing."""
    if isinstance(error, CardFull):
        raise error
    return ScpiError(-225, str(error) if isinstance(error, OutOfMemory) else "this machine's memory")


def _joined(replies: list[Chunk], reply: list[Chunk]) -> list[Chunk]:
    return [*replies, b";", *reply] if replies and reply else replies + reply
