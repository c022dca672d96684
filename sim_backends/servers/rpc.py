"""Remote procedure calls on one TCP connection (RFC 5531: ONC RPC, record marking; RFC 4506: XDR)."""

import selectors
import socket
import struct
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from sim_backends.scpi.messages import Chunk
from sim_backends.servers.disturbed import INTACT, Disturbed, fragments, pieces
from sim_backends.servers.socket import Channel

_MARK = struct.Struct("!I")
_LAST_FRAGMENT = 0x8000_0000
_INTEGER = struct.Struct("!i")
_UNSIGNED = struct.Struct("!I")
_CALL_HEAD = struct.Struct("!6I")  # number, CALL, RPC version, program, its version, procedure
_REPLY_HEAD = struct.Struct("!6I")  # number, REPLY, MSG_ACCEPTED, verifier: AUTH_NONE, no bytes; how it went
_DENIED = struct.Struct("!6I")  # number, REPLY, MSG_DENIED, RPC_MISMATCH, lowest and highest version
_CALL, _REPLY = 0, 1
_RPC_VERSION = 2
_NULL_PROCEDURE = 0  # of every program: answers with nothing (RFC 5531, 12.1)


class Accepted(IntEnum):
    """How an accepted call went (RFC 5531, accept_stat)."""

    SUCCESS = 0
    PROGRAM_UNAVAILABLE = 1
    PROGRAM_MISMATCH = 2
    PROCEDURE_UNAVAILABLE = 3
    GARBAGE_ARGUMENTS = 4


class GarbageArguments(Exception):
    """The arguments of a call are not what the procedure takes."""


class Arguments:
    """XDR values, taken one by one from the front of `data`."""

    def __init__(self, data: memoryview) -> None:
        self._data = data
        self._at = 0

    def integer(self) -> int:
        """The next 32 bits, signed.

        Raises:
            GarbageArguments: there are none left.
        """
        return int(_INTEGER.unpack(self._take(4))[0])

    def unsigned(self) -> int:
        """The next 32 bits, unsigned, likewise."""
        return int(_UNSIGNED.unpack(self._take(4))[0])

    def opaque(self) -> memoryview:
        """The next counted bytes, without the zeros that fill the last four."""
        length = self.unsigned()
        data = self._take(length)
        self._take(-length % 4)
        return data

    def _take(self, count: int) -> memoryview:
        taken = self._data[self._at : self._at + count]
        if len(taken) < count:
            raise GarbageArguments
        self._at += count
        return taken


class Call(NamedTuple):
    """A call: which one of its caller's it is, and what it asks for."""

    number: int
    program: int
    version: int
    procedure: int
    arguments: Arguments


def unsigned(*values: int) -> bytes:
    """`values` as XDR, 32 bits each."""
    return struct.pack(f"!{len(values)}I", *values)


def opaque(chunks: list[Chunk]) -> list[Chunk]:
    """`chunks` as one counted XDR value."""
    length = sum(map(len, chunks))
    return [unsigned(length), *chunks, bytes(-length % 4)]


class RecordReader:
    """Cuts the bytes of a connection into records.

    Args:
        largest: Bytes of the longest record that is taken.
        complete: Called with every complete record.
        rubbish: Called when a longer one is announced.
    """

    def __init__(self, *, largest: int, complete: Callable[[memoryview], None], rubbish: Callable[[], None]) -> None:
        self._largest = largest
        self._complete = complete
        self._rubbish = rubbish
        self._begin(_MARK.size)
        self._in_mark = True
        self._last = False
        self._fragments = b""  # those before the one under way

    def read(self, channel: Channel) -> bool:
        """Receive what is there, at most to the end of one record; returns False at the end of the connection."""
        while True:
            if self._got < len(self._bytes):
                count = channel.receive(memoryview(self._bytes)[self._got :])
                if not count:
                    return count is None
                self._got += count
            elif self._in_mark:
                (mark,) = _MARK.unpack(self._bytes)
                length = mark & ~_LAST_FRAGMENT
                self._last = bool(mark & _LAST_FRAGMENT)
                if len(self._fragments) + length > self._largest or not (length or self._last):  # nor one without end
                    self._rubbish()
                    return True
                self._in_mark = False
                self._begin(length)
            else:
                record = self._fragments + self._bytes if self._fragments else self._bytes
                self._fragments = b"" if self._last else bytes(record)
                self._in_mark = True
                self._begin(_MARK.size)
                if self._last:
                    self._complete(memoryview(record))
                    return True

    def _begin(self, length: int) -> None:
        self._bytes = bytearray(length)
        self._got = 0


class RpcConnection:
    """One client's connection to one program.

    Args:
        selector: What reports that the connection can be read or written.
        connection: An accepted connection; belongs to this object from now on.
        program: The program's number.
        version: The only version of it.
        procedures: Number -> what to do with a call; it answers by `succeed`, at once or later.
        largest: Bytes of the longest call.
        ended: Called once when the client is gone.
    """

    def __init__(
        self,
        selector: selectors.BaseSelector,
        connection: socket.socket,
        *,
        program: int,
        version: int,
        procedures: dict[int, Callable[[Call], None]],
        largest: int,
        ended: Callable[[], object],
    ) -> None:
        self._program, self._version, self._procedures = program, version, procedures
        self._forget = ended
        self._ended = False
        self._records = RecordReader(largest=largest, complete=self._record, rubbish=self.end)
        self.channel = Channel(selector, connection, readable=self._readable, lost=self.end)

    def succeed(self, call: Call, results: list[Chunk], disturbed: Disturbed = INTACT) -> None:
        """Answer `call` with `results`, XDR, as far as `disturbed` lets it come."""
        if disturbed is INTACT:
            self._answer(call.number, Accepted.SUCCESS, results)
        else:
            head = _REPLY_HEAD.pack((call.number + disturbed.numbered) % 2**32, _REPLY, 0, 0, 0, Accepted.SUCCESS)
            for piece in pieces(_disturbed_record(b"".join((head, *map(bytes, results))), disturbed), disturbed.packet):
                self.channel.send((piece,))

    def end(self) -> None:
        """Give up the connection; nothing is read or sent any more."""
        if not self._ended:
            self._ended = True
            self.channel.close()
            self._forget()

    def _readable(self) -> None:
        if not self._records.read(self.channel):
            self.end()

    def _record(self, record: memoryview) -> None:
        try:
            call = self._call(record)
        except GarbageArguments:
            self.end()  # not even a call: what follows cannot be read either
            return
        if call is None:
            return
        if call.program != self._program:
            self._answer(call.number, Accepted.PROGRAM_UNAVAILABLE)
        elif call.version != self._version:
            self._answer(call.number, Accepted.PROGRAM_MISMATCH, [unsigned(self._version, self._version)])
        elif call.procedure == _NULL_PROCEDURE:
            self.succeed(call, [])
        elif call.procedure not in self._procedures:
            self._answer(call.number, Accepted.PROCEDURE_UNAVAILABLE)
        else:
            try:
                self._procedures[call.procedure](call)
            except GarbageArguments:
                self._answer(call.number, Accepted.GARBAGE_ARGUMENTS)

    def _call(self, record: memoryview) -> Call | None:
        """The call in a record; None: it was refused, or is none."""
        if len(record) < _CALL_HEAD.size:
            raise GarbageArguments
        number, kind, rpc_version, program, version, procedure = _CALL_HEAD.unpack_from(record)
        if kind != _CALL:
            raise GarbageArguments
        if rpc_version != _RPC_VERSION:
            self._send(_DENIED.pack(number, _REPLY, 1, 0, _RPC_VERSION, _RPC_VERSION), [])
            return None
        arguments = Arguments(record[_CALL_HEAD.size :])
        for _ in ("credential", "verifier"):  # callers are not checked
            arguments.integer()
            arguments.opaque()
        return Call(number, program, version, procedure, arguments)

    def _answer(self, number: int, how: Accepted, results: list[Chunk] | None = None) -> None:
        self._send(_REPLY_HEAD.pack(number, _REPLY, 0, 0, 0, how), results or [])

    def _send(self, head: bytes, results: list[Chunk]) -> None:
        length = len(head) + sum(map(len, results))
        self.channel.send([_MARK.pack(_LAST_FRAGMENT | length), head, *results])


def _disturbed_record(record: bytes, disturbed: Disturbed) -> bytes:
    """What of a record comes, with its marks."""
    parts = fragments(record, disturbed.fragments)
    flags = [0] * (len(parts) - 1) + [_LAST_FRAGMENT]
    marks = [_MARK.pack(flag | len(part) + disturbed.announced) for flag, part in zip(flags, parts, strict=True)]
    whole = b"".join(mark + part for mark, part in zip(marks, parts, strict=True))
    missing = 0 if disturbed.ends_after is None else len(disturbed.data) - disturbed.ends_after
    return whole[: len(whole) - max(0, missing)]
