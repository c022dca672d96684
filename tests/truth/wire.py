"""A line to one virtual instrument, and what it thinks of what it is sent."""

import re
import socket
from types import TracebackType
from typing import NamedTuple, Self

_ADDRESS = re.compile(r"TCPIP0::([\d.]+)::(\d+)::SOCKET")
_END = re.compile(rb'(?:^|\n)\d+;(-?\d+,"[^\n]*)\n$')
_EVENT = re.compile(r'(-?\d+),"((?:[^"]|"")*)"')
_NOTHING = (0, 1, 402)  # no events, events pending, operation complete
PATIENCE_S = 3.0


class Answer(NamedTuple):
    """What came back: the reply, "" for none, and the events, each as its number and text."""

    reply: str
    events: tuple[tuple[int, str], ...]

    @property
    def refused(self) -> bool:
        """Whether the instrument did not do what it was told."""
        return bool(self.events)

    @property
    def undefined(self) -> bool:
        """Whether it does not know the header, be it nonsense or not simulated."""
        return any(abs(number) == 113 for number, _ in self.events)

    @property
    def told_apart(self) -> bool:
        """Whether it says that the header is real and only not simulated."""
        return any("not simulated" in text for number, text in self.events if abs(number) == 113)


class Instrument:
    """One virtual instrument on its raw socket.

    Args:
        address: `TCPIP0::host::port::SOCKET`.
        events: The query for all events, `ALLEv?` or `SYSTem:ERRor:ALL?`.
    """

    def __init__(self, address: str, events: str) -> None:
        found = _ADDRESS.fullmatch(address)
        if found is None:
            raise ValueError(f"{address} is no address of a raw socket")
        self._where = found[1], int(found[2])
        self._events = f"*ESR?;:{events}"
        self._connect()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._socket.close()

    def send(self, text: str) -> Answer:
        """Send a command or a query, and ask for the events; one that waits for an acquisition is given up."""
        try:
            reply, told = self._exchange(text)
        except TimeoutError:
            self._socket.close()
            self._connect()
            return Answer("", ())
        return Answer(reply, _events(told))

    def _connect(self) -> None:
        self._socket = socket.create_connection(self._where, timeout=PATIENCE_S)

    def _exchange(self, text: str) -> tuple[str, str]:
        """The reply to `text`, and what the query for events brings, which marks the end."""
        received = b""
        self._socket.sendall(f"{text}\n{self._events}\n".encode("latin-1"))
        while not (end := _END.search(received)):
            part = self._socket.recv(1 << 16)
            if not part:
                raise ConnectionError(f"the instrument hung up after {text!r}")
            received += part
        return received[: end.start()].decode("latin-1").strip(), end[1].decode("latin-1")


def _events(told: str) -> tuple[tuple[int, str], ...]:
    found = ((int(number), text) for number, text in _EVENT.findall(told))
    return tuple((number, text) for number, text in found if number not in _NOTHING)
