"""A faulty instrument: it is between the transports and a virtual one, and passes on what the faults let pass."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import lru_cache
from itertools import zip_longest

from sim_backends.faults.catalogue import Arrival, Fault, Moment
from sim_backends.faults.distortions import Distortion
from sim_backends.scpi.messages import Message, Unit
from sim_backends.servers.disturbed import Disturbed
from sim_backends.servers.loop import Execution, Instrument
from sim_backends.virtual.instrument import VirtualInstrument

_logger = logging.getLogger(__name__)

SHORTEST_WORD = 3
"""Letters that a word of a header has at least to stand for a longer one."""


class Injection:
    """One fault of one instrument: when it strikes, and what it does to each message and its reply.

    Attributes:
        fault: What goes wrong.
        struck: Whether it has.
        refuse: Makes every address of the instrument refuse connections.
    """

    def __init__(self, role: str, instrument: Instrument, fault: Fault, moment: Moment) -> None:
        self.fault = fault
        self.struck = False
        self.refuse: Callable[[], None] = lambda: None
        self._role = role
        self._instrument = instrument
        self._moment = moment
        self._seen = 0

    def is_due(self, header: str) -> bool:
        """Whether the fault will strike a message with this header if it comes now."""
        return self._strikes(self._seen + 1) and same_header(header, self._moment.header)

    def meets(self, message: Message) -> Distortion | None:
        """What becomes of the reply to `message`; None: the fault leaves it alone."""
        headers = [header_of(unit) for unit in message.units]
        if any(same_header(header, self._moment.header) for header in headers):
            self._seen += 1
            if self._strikes(self._seen):
                self._strike()
                return self._answer(headers) or self.fault.reply
        if not self.struck:
            return None
        return self._answer(headers) or (self.fault.reply if self.fault.lasting else None)

    def begin(self) -> None:
        """Before the first connection."""
        if self._moment.count == 0:
            self._strike()

    def go_on(self) -> None:
        """Before a reply is sent: what lasts in the world, lasts whatever was sent to the instrument meanwhile."""
        if self.struck and self.fault.lasting:
            self._happen()

    def _strikes(self, seen: int) -> bool:
        return self._moment.count <= seen < self._moment.count + self._moment.times

    def _strike(self) -> None:
        if not self.struck:
            _logger.warning("fault at %s: %s", self._role, self.fault.told)
        self.struck = True
        if self.fault.refuses:
            self.refuse()
        self._happen()

    def _happen(self) -> None:
        if self.fault.happens is not None and isinstance(self._instrument, VirtualInstrument):
            self.fault.happens(self._instrument)

    def _answer(self, headers: Sequence[str]) -> Distortion | None:
        """What one of its queries is answered from now on, if the fault says so."""
        queries = [header for header in headers if header.endswith("?")]
        for place, query in enumerate(queries):
            for header, reply in self.fault.answers.items():
                if same_header(query, header):
                    return in_place(place, len(queries), reply)
        return None


class Faulty:
    """An instrument that faults befall; what one of them takes, the others do not see."""

    def __init__(self, instrument: Instrument, injections: Sequence[Injection]) -> None:
        self._instrument = instrument
        self._injections = injections

    def run(self, message: Message) -> Execution:
        """Execute `message` as far as the faults let it come, and reply as they have it."""
        for injection in self._injections:
            distortion = injection.meets(message)
            if distortion is not None:
                heard = without(message, injection.fault.deaf_to)
                return (yield from self._disturbed(heard, injection.fault.arrives, distortion))
        reply = yield from self._instrument.run(message)
        self._go_on()
        return reply

    @contextmanager
    def connection(self) -> Iterator["Faulty"]:
        """As one client has it: the faults are those of all clients."""
        with self._instrument.connection() as instrument:
            yield Faulty(instrument, self._injections)

    def clear(self) -> None:
        """Device clear."""
        self._instrument.clear()

    def status_byte(self) -> int:
        """The status byte."""
        return self._instrument.status_byte()

    def listens(self, begun: bytes) -> bool:
        """Whether no fault ends the link inside the block that follows `begun`."""
        header = begun.decode("latin-1").split(None, 1)[0]
        for injection in self._injections:
            if injection.fault.arrives is Arrival.CUT and injection.is_due(header):
                injection.meets(Message((Unit(header, query=False, arguments=()),)))
                return False
        return True

    def _disturbed(self, message: Message, arrival: Arrival, distortion: Distortion) -> Execution:
        if arrival is Arrival.IGNORED:
            return []
        if arrival is Arrival.FEIGNED:
            return distortion(b"\n")
        if arrival is not Arrival.HEARD:
            return Disturbed(ends_after=0)
        reply = yield from self._instrument.run(message)
        self._go_on()
        if isinstance(reply, Disturbed):
            return reply
        if reply:
            return distortion(b"".join((*map(bytes, reply), b"\n")))
        return Disturbed(ends_after=0) if distortion(b"\n").hangs_up else []

    def _go_on(self) -> None:
        for injection in self._injections:
            injection.go_on()


def in_place(place: int, count: int, distortion: Distortion) -> Distortion:
    """Of the reply to so many queries in one message, the answer in one place is distorted; a block is the last one."""

    def distorted(reply: bytes) -> Disturbed:
        answers = reply[:-1].split(b";", count - 1)
        found = distortion(answers[place] + b"\n")
        answers[place] = found.data[:-1]
        return replace(found, data=b";".join(answers) + b"\n")

    return distortion if count == 1 else distorted


def without(message: Message, header: str) -> Message:
    """`message` without the commands of this header; an empty one is none."""
    if not header:
        return message
    return Message(tuple(unit for unit in message.units if not same_header(header_of(unit), header)))


def header_of(unit: Unit) -> str:
    """The header of a command or query without a leading colon, `?` at its end if it is a query."""
    return unit.header.lstrip(":") + ("?" if unit.query else "")


@lru_cache(maxsize=1024)
def same_header(one: str, other: str) -> bool:
    """Whether two headers are the same but for case and length of their words; an empty `other` is any header."""
    if not other:
        return True
    if one.endswith("?") is not other.endswith("?"):
        return False
    words = (header.strip(":?").upper().split(":") for header in (one, other))
    return all(_same_word(*pair) for pair in zip_longest(*words, fillvalue=""))


def _same_word(one: str, other: str) -> bool:
    (short, number), (long, other_number) = sorted((_split(one), _split(other)), key=lambda split: len(split[0]))
    return number == other_number and (short == long or (len(short) >= SHORTEST_WORD and long.startswith(short)))


def _split(word: str) -> tuple[str, str]:
    """A word and its numeric suffix, 1 if it has none."""
    letters = word.rstrip("0123456789")
    return letters, word[len(letters) :] or "1"
