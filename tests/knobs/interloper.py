"""A simulated bench with another client on it, who says one thing at a moment that the run's own messages fix."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import NamedTuple

from sim_backends.bench import SimulatedBench
from sim_backends.faults.catalogue import Fault, Moment
from sim_backends.faults.injection import Faulty, Injection, header_of, same_header
from sim_backends.parameters import Parameters
from sim_backends.scpi.messages import Message
from sim_backends.servers.loop import Execution, Instrument, Loop
from sim_backends.virtual.instrument import VirtualInstrument
from tests.sim_backends.virtual.watched import messages

READS = ("CURVe?", "CURVENext?", "WAVFrm?")
STARTS = ("ALP:PROJSTART", "ALP:PROJSTARTCONT")


class Event(NamedTuple):
    """Something that a run says.

    what: `arm`, the `number`th start of an acquisition; `start`, the first projection after it; `read`, the `part`th
    question for points after it; `pass`, the patching of the `number`th pass.
    """

    what: str
    number: int
    part: int = 1


class Overheard:
    """What a run says that a moment can be told by.

    Attributes:
        events: all that was heard, in order.
    """

    def __init__(self) -> None:
        self.events: list[Event] = []
        self._arms = self._parts = self._passes = 0
        self._patched = self._started = False

    def hears(self, role: str, message: Message) -> Event | None:
        """The event that `message` to `role` is, if it is one."""
        event = self._event(role, message)
        if event is not None:
            self.events.append(event)
        return event

    def arms(self, before: Event | None = None) -> int:
        """Acquisitions that were started, before an event or in all."""
        events = self.events if before is None else self.events[: self.events.index(before)]
        return sum(event.what == "arm" for event in events)

    def _event(self, role: str, message: Message) -> Event | None:
        headers = {header_of(unit) for unit in message.units}
        if role == "scope" and any(
            same_header(header_of(unit), "ACQuire:STATE") and unit.arguments in (("RUN",), ("1",), ("ON",))
            for unit in message.units
        ):
            self._arms += 1
            self._parts, self._patched, self._started = 0, False, False
            return Event("arm", self._arms)
        if role == "scope" and any(same_header(header, read) for header in headers for read in READS):
            self._parts += 1
            return Event("read", self._arms, self._parts)
        if role == "dmd" and not self._started and any(header in STARTS for header in headers):
            self._started = True
            return Event("start", self._arms)
        if (
            role == "patch_panel"
            and not self._patched
            and any(same_header(header, "ROUTe:CLOSe") for header in headers)
        ):
            self._patched = True
            self._passes += 1
            return Event("pass", self._passes)
        return None


class VisitedBench(SimulatedBench):
    """A simulated bench on which `visit` is called once, in the bench's own thread, right before an event.

    Attributes:
        overheard: what clients have said.
        visited: whether it was called.
    """

    def __init__(
        self,
        parameters: Parameters | None = None,
        *,
        moment: Event | None = None,
        visit: Callable[["VisitedBench"], None] = lambda _bench: None,
    ) -> None:
        super().__init__(parameters, noise="by-state")
        self.overheard = Overheard()
        self.visited = False
        self._moment = moment
        self._visit = visit
        self._injections: dict[str, list[Injection]] = {role: [] for role in self._instruments}

    def say(self, role: str, lines: bytes) -> bytes:
        """What an instrument answers a client who sends it `lines`; the bench's own thread only, or an idle bench."""
        reply = b""
        for message in messages(lines):
            execution = self.virtual(role).run(message)
            try:
                while True:
                    next(execution)
            except StopIteration as end:
                reply += b"".join(map(bytes, end.value))
        return reply

    def virtual(self, role: str) -> VirtualInstrument:
        """The instrument itself."""
        instrument = self._instruments[role]
        assert isinstance(instrument, VirtualInstrument)
        return instrument

    def befall(self, role: str, fault: Fault, moment: Moment) -> None:
        """From now on a fault waits for its moment, and messages are counted for it."""
        self._injections[role].append(Injection(role, self.virtual(role), fault, moment))

    def hears(self, role: str, message: Message) -> None:
        """A client's message to `role`, before the instrument gets it."""
        event = self.overheard.hears(role, message)
        if event is not None and event == self._moment and not self.visited:
            self.visited = True
            self._visit(self)

    def _serve(self, loop: Loop, role: str, instrument: Instrument, rank: int) -> dict[str, str]:
        faulty = Faulty(instrument, self._injections[role])
        return super()._serve(loop, role, _Overheard(faulty, role, self.hears), rank)


class _Overheard:
    """An instrument whose messages somebody else hears first."""

    def __init__(self, instrument: Instrument, role: str, hears: Callable[[str, Message], None]) -> None:
        self._instrument = instrument
        self._role = role
        self._hears = hears

    def run(self, message: Message) -> Execution:
        self._hears(self._role, message)
        return (yield from self._instrument.run(message))

    def clear(self) -> None:
        self._instrument.clear()

    def status_byte(self) -> int:
        return self._instrument.status_byte()

    def listens(self, begun: bytes) -> bool:
        return self._instrument.listens(begun)

    @contextmanager
    def connection(self) -> Iterator["_Overheard"]:
        with self._instrument.connection() as instrument:
            yield _Overheard(instrument, self._role, self._hears)


def moments(events: Overheard, records: int) -> Mapping[str, Event]:
    """The moments of an undisturbed run whose passes end with so many acquisitions of records each, by name."""
    second = Event("pass", 2)
    first_leg, arms = events.arms(before=second), events.arms()
    middle = first_leg - records // 2
    parts = max(event.part for event in events.events if event.what == "read" and event.number == middle)
    return {
        "ranging": Event("arm", 1),
        "between records": Event("arm", middle),
        "between channels": Event("read", middle, parts),
        "before the picture": Event("start", middle),
        "next pass": second,
        "last record": Event("arm", arms),
    }
