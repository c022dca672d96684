"""How fast VisaLink moves blocks, beside a raw socket in the same run.

    python benchmarks/blocks.py

Serves 10 MB blocks of random bytes on loopback, and takes 4 MB ones, from a thread that does nothing else.
"""

import json
import socket
import sys
import threading
import time
from collections.abc import Callable

import numpy as np

from instruments.visa import VisaLink

READ_BYTES, WRITE_BYTES = 10_000_000, 4_000_000
REPETITIONS = 9
HEADER = b"#8%08d"


def serve(listener: socket.socket, reply: bytes) -> None:
    """Answer `CURVe?` with `reply`, take a written block, answer `*OPC?`; one client."""
    client, _ = listener.accept()
    client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    buffer = bytearray(1 << 20)
    while received := client.recv_into(buffer):
        if buffer[received - 7 : received] == b"CURVe?\n":
            client.sendall(reply)
        elif buffer[received - 6 : received] == b"*OPC?\n":
            client.sendall(b"1\n")


def median_s(action: Callable[[], object]) -> float:
    """Median duration of `action`."""
    durations = []
    for _ in range(REPETITIONS):
        started = time.perf_counter()
        action()
        durations.append(time.perf_counter() - started)
    return float(np.median(durations))


def connect(reply: bytes) -> tuple[str, int]:
    """Start a server and return its address."""
    listener = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=serve, args=(listener, reply), daemon=True).start()
    address: tuple[str, int] = listener.getsockname()
    return address


def main() -> None:
    """Measure and print one JSON object."""
    trace = np.random.default_rng(0).integers(0, 256, READ_BYTES, dtype=np.uint8)
    block = np.random.default_rng(1).random(WRITE_BYTES // 4, dtype=np.float32)
    reply = HEADER % READ_BYTES + trace.tobytes() + b"\n"

    raw = socket.create_connection(connect(reply))
    raw.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    room = bytearray(len(reply))

    def read_raw() -> None:
        raw.sendall(b"CURVe?\n")
        view = memoryview(room)
        while view:
            view = view[raw.recv_into(view) :]

    def write_raw() -> None:
        raw.sendall(b"DATA " + HEADER % WRITE_BYTES)
        raw.sendall(block.data.cast("B"))
        raw.sendall(b"\n")
        raw.sendall(b"*OPC?\n")
        raw.recv(2)

    host, port = connect(reply)
    link = VisaLink(f"TCPIP0::{host}::{port}::SOCKET", name="benchmark", timeout_s=10, transcript=lambda *_: None)

    def write_link() -> None:
        link.write_block("DATA ", block)
        link.query("*OPC?")

    reference = {"read": median_s(read_raw), "write": median_s(write_raw)}
    measured = {
        "read": median_s(lambda: link.read_block("CURVe?", np.dtype(np.uint8))),
        "write": median_s(write_link),
        "query": median_s(lambda: link.query("*OPC?")),
    }
    result = {
        "read_mb_per_s": READ_BYTES / measured["read"] / 1e6,
        "read_share_of_raw_socket": reference["read"] / measured["read"],
        "write_mb_per_s": WRITE_BYTES / measured["write"] / 1e6,
        "write_share_of_raw_socket": reference["write"] / measured["write"],
        "query_us": measured["query"] * 1e6,
    }
    sys.stdout.write(json.dumps({key: round(value, 3) for key, value in result.items()}) + "\n")


if __name__ == "__main__":
    main()
