"""The simulated bench with one faulty instrument: what it hears and what it says passes the fault."""

import selectors
import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Any

from sim_backends.bench import SimulatedBench
from sim_backends.faults.catalogue import Arrival, Fault, Moment
from sim_backends.faults.distortions import Distortion, intact
from sim_backends.parameters import Parameters
from sim_backends.scpi.messages import Message
from sim_backends.servers.channel import Chunk
from sim_backends.servers.clients import Instrument
from sim_backends.servers.loop import Loop
from sim_backends.servers.socket import SocketClient
from sim_backends.virtual.instrument import VirtualInstrument


class FaultyBench(SimulatedBench):
    """A simulated bench in which `fault` befalls the instrument `role` at `moment`, on its raw socket.

    The other instruments, and the other addresses of this one, are as they always are.
    """

    def __init__(
        self,
        role: str,
        fault: Fault,
        moment: Moment,
        parameters: Parameters | None = None,
        *,
        twin_seed: int = 1,
        laser_table: Mapping[str, Any] | None = None,
    ) -> None:
        super().__init__(parameters, twin_seed=twin_seed, laser_table=laser_table)
        self._role = role
        self._fault = fault
        self._moment = moment
        self._injection: Injection | None = None

    @property
    def struck(self) -> bool:
        """Whether the moment of the fault has come."""
        return self._injection is not None and self._injection.struck

    def stop(self) -> None:
        """As that of every simulated bench."""
        super().stop()
        if self._injection is not None:
            self._injection.listener.close()

    def _serve(self, loop: Loop, role: str, instrument: Instrument, rank: int) -> dict[str, str]:
        addresses = super()._serve(loop, role, instrument, rank)
        if role == self._role:
            self._injection = Injection(loop, instrument, self._fault, self._moment)
            host, port = self._injection.listener.getsockname()
            addresses["socket"] = f"TCPIP0::{host}::{port}::SOCKET"
        return addresses


class Injection:
    """One fault of one instrument: when it strikes, and what it does to each message and its reply.

    Attributes:
        fault: What goes wrong.
        struck: Whether it has.
        listener: Where clients connect; to be closed by the owner.
    """

    def __init__(self, loop: Loop, instrument: Instrument, fault: Fault, moment: Moment) -> None:
        self.fault = fault
        self.struck = False
        self.listener = socket.create_server(("127.0.0.1", 0))
        self._loop = loop
        self._instrument = instrument
        self._moment = moment
        self._left = moment.count
        self.listener.settimeout(0)
        loop.selector.register(self.listener, selectors.EVENT_READ, self._accept)
        if self._left == 0:
            self._strike()

    def meets(self, message: Message) -> Distortion | None:
        """What becomes of the reply to `message`; None: the fault leaves it alone."""
        header = header_of(message)
        if not self.struck:
            self._left -= header == self._moment.header
            if self._left > 0:
                return None
            self._strike()
            return self.fault.answers.get(header, self.fault.reply)
        if header in self.fault.answers:
            return self.fault.answers[header]
        return self.fault.reply if self.fault.lasting else None

    def goes_on(self) -> None:
        """Before a reply is sent: what lasts in the world, lasts whatever the instrument has been told meanwhile."""
        if self.struck and self.fault.lasting:
            self._happen()

    def _strike(self) -> None:
        self.struck = True
        if self.fault.refuses:
            self._loop.selector.unregister(self.listener)
            self.listener.shutdown(socket.SHUT_RDWR)  # refuses from now on, and keeps the port
        self._happen()

    def _happen(self) -> None:
        if self.fault.happens is not None and isinstance(self._instrument, VirtualInstrument):
            self.fault.happens(self._instrument)

    def _accept(self, _events: int) -> None:
        with suppress(BlockingIOError, ConnectionAbortedError):  # gone again
            FaultyClient(self._loop, self._instrument, self.listener.accept()[0], self)


class FaultyClient(SocketClient):
    """A client on a raw socket of the faulty instrument."""

    def __init__(self, loop: Loop, instrument: Instrument, connection: socket.socket, injection: Injection) -> None:
        super().__init__(loop, instrument, connection)
        self._injection = injection
        self._distortions: list[Distortion] = [intact]  # the tag of a request is the place of its own
        self._held = b""

    def deliver(self, messages: list[Message], tag: int = 0) -> None:
        """Queue `messages` for execution, as far as the fault lets them come."""
        for message in messages:
            if self._ended:
                return
            distortion = self._injection.meets(message)
            if distortion is None:
                super().deliver([message])
                continue
            arrival = self._injection.fault.arrives
            if arrival is Arrival.LOST:
                self._hang_up()
            elif arrival is Arrival.HEARD:
                self._distortions.append(distortion)
                super().deliver([message], len(self._distortions) - 1)
                if not message.queries and distortion(b"\n").hangs_up:
                    self._end()

    def reply(self, chunks: list[Chunk], tag: int) -> None:
        """Send what the fault makes of `chunks` and a line feed."""
        self._injection.goes_on()
        whole = b"".join((*map(bytes, chunks), b"\n"))
        became = self._distortions[tag](whole)
        held, self._held = self._held, became.held
        for piece in (held, *became.pieces):
            self._channel.send((piece,))
        if became.hangs_up:
            self._hang_up()

    def _hang_up(self) -> None:
        self._channel.close()
        self._end()


def header_of(message: Message) -> str:
    """The header of the message's last unit, without a leading colon, `?` at its end if it is a query."""
    unit = message.units[-1]
    return unit.header.lstrip(":") + ("?" if unit.query else "")
