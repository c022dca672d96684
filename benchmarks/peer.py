"""A process that answers as instruments do and does nothing else, so that what is measured is the way there."""

import multiprocessing
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.connection import Connection

HEADER = b"#8%08d"
LENGTH = re.compile(rb"[^#]*#([1-9])")
ROOM = 1 << 20


@contextmanager
def peer(block: bytes = b"") -> Iterator[tuple[str, int]]:
    """Its address: it answers `CURVe?` with `block`, any other line with `0,1000`, and each block it gets with `0`."""
    context = multiprocessing.get_context("spawn")
    told, tell = context.Pipe(duplex=False)
    process = context.Process(target=_serve, args=(tell, block), daemon=True)
    process.start()
    try:
        yield told.recv()
    finally:
        process.kill()
        process.join()


def connected(address: tuple[str, int]) -> socket.socket:
    """A bare socket to one."""
    link = socket.create_connection(address)
    link.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return link


def _serve(tell: Connection, block: bytes) -> None:
    reply = HEADER % len(block) + block + b"\n"
    with socket.create_server(("127.0.0.1", 0)) as listener:
        tell.send(listener.getsockname())
        while True:
            client, _ = listener.accept()
            threading.Thread(target=_answer, args=(client, reply), daemon=True).start()


def _answer(client: socket.socket, reply: bytes) -> None:
    """One client, which waits for each answer before it goes on."""
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    room = memoryview(bytearray(ROOM))
    text = b""
    while count := client.recv_into(room):
        text += bytes(room[:count])
        if head := LENGTH.match(text):
            digits = int(head[1])
            begin = head.end() + digits
            if len(text) < begin:
                continue
            left = begin + int(text[begin - digits : begin]) + len(b"\n") - len(text)
            while left:
                left -= client.recv_into(room[:left])
            client.sendall(b"0\n")
        elif text.endswith(b"\n"):
            client.sendall(reply if text == b"CURVe?\n" else b"0,1000\n")
        else:
            continue
        text = b""
