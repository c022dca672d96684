"""How fast VisaLink moves blocks, beside a raw socket in the same run; how fast the simulated bench answers anybody.

    python benchmarks/blocks.py

Serves 10 MB blocks of random bytes on loopback, and takes 4 MB ones, from a thread that does nothing else. The
simulated generator is asked by plain PyVISA: a setting and a query in two messages, on each transport.
"""

import json
import socket
import sys
import threading
import time
from collections.abc import Callable
from typing import cast

import numpy as np
import pyvisa
from pyvisa.resources import MessageBasedResource

from instruments.visa import VisaLink
from sim_backends.bench import SimulatedBench

READ_BYTES, WRITE_BYTES = 10_000_000, 4_000_000
REPETITIONS = 15
QUERIES = 500
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


def medians_s(*actions: Callable[[], object], repetitions: int = REPETITIONS) -> list[float]:
    """Median duration of each of `actions`, taken in turn so that whatever else the machine does meets all of them."""
    durations = np.empty((repetitions, len(actions)))
    for row in durations:
        for place, action in enumerate(actions):
            started = time.perf_counter()
            action()
            row[place] = time.perf_counter() - started
    return [float(median) for median in np.median(durations, axis=0)]


def connect(reply: bytes) -> tuple[str, int]:
    """Start a server and return its address."""
    listener = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=serve, args=(listener, reply), daemon=True).start()
    address: tuple[str, int] = listener.getsockname()
    return address


def stock_client_s() -> dict[str, float]:
    """Median time of a setting and a query by plain PyVISA, by transport."""
    manager = pyvisa.ResourceManager("@py")
    found = {}
    with SimulatedBench() as bench:
        for transport, address in bench.resources["awg"].items():
            opened = manager.open_resource(address, read_termination="\n", write_termination="\n")
            awg = cast(MessageBasedResource, opened)

            def set_and_query(awg: MessageBasedResource = awg) -> None:
                awg.write("SOURce1:VOLTage 0.3")
                awg.query("SOURce1:VOLTage?")

            (found[transport],) = medians_s(set_and_query, repetitions=QUERIES)
            awg.close()
    return found


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

    raw_read_s, read_s = medians_s(read_raw, lambda: link.read_block("CURVe?", np.empty(READ_BYTES, np.uint8)))
    raw_write_s, write_s = medians_s(write_raw, write_link)
    (query_s,) = medians_s(lambda: link.query("*OPC?"), repetitions=QUERIES)
    result = {
        "read_mb_per_s": READ_BYTES / read_s / 1e6,
        "read_share_of_raw_socket": raw_read_s / read_s,
        "write_mb_per_s": WRITE_BYTES / write_s / 1e6,
        "write_share_of_raw_socket": raw_write_s / write_s,
        "query_us": query_s * 1e6,
        **{f"stock_pyvisa_{name}_set_and_query_us": seconds * 1e6 for name, seconds in stock_client_s().items()},
    }
    sys.stdout.write(json.dumps({key: round(value, 3) for key, value in result.items()}) + "\n")


if __name__ == "__main__":
    main()
