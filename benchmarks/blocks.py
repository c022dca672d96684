"""How fast blocks go through VisaLink, and pictures to a DMD, beside a bare socket; how fast the twin answers anybody.

Blocks of 10 MB are read and of 4 MB written, and a memory of 1000 pictures is filled as before bursts, from and to
another process that does nothing else; the bare socket sends and receives the very same bytes. The simulated generator
is asked by plain PyVISA: a setting and a query in two messages, on each transport.
"""

from collections.abc import Iterator
from typing import cast

import numpy as np
import pyvisa
from pyvisa.resources import MessageBasedResource

from benchmarks.peer import HEADER, connected, peer
from benchmarks.rows import Goal, Row, interleaved
from instruments.alp_library import AlpOverVisa
from instruments.vialux_alp import VialuxAlp
from instruments.visa import VisaLink, room_for_blocks
from protocols.bursts import UPLOAD_BLOCK
from sim_backends.bench import SimulatedBench

READ_BYTES, WRITE_BYTES = 10_000_000, 4_000_000
PICTURE = (1000, 125)
"""Rows, and bytes of a row, of a DMD that gives its sides, and how many pictures it holds, as 1000."""
FILLED = 1000 // UPLOAD_BLOCK
"""Blocks that fill it."""
REPETITIONS = 15
QUERIES = 500
SHARE = Goal(least=0.9)
AGAINST = "bare socket"


def link_to(address: tuple[str, int]) -> VisaLink:
    """A link that nobody listens to."""
    host, port = address
    return VisaLink(f"TCPIP0::{host}::{port}::SOCKET", name="peer", timeout_s=10, transcript=lambda *_: None)


def moved(what: str, size: int, ours_s: float, bare_s: float) -> Row:
    """A row of so many bytes."""
    return Row(what, size / ours_s / 1e6, "MB/s", against=AGAINST, reference=size / bare_s / 1e6, goal=SHARE)


def blocks() -> Iterator[Row]:
    """Read and written."""
    trace = np.random.default_rng(0).integers(0, 256, READ_BYTES, dtype=np.uint8).tobytes()
    block = np.random.default_rng(1).random(WRITE_BYTES // 4, dtype=np.float32)
    with peer(trace) as address, connected(address) as bare:
        link = link_to(address)
        (codes,), room = room_for_blocks((1, READ_BYTES), np.uint8), bytearray(len(HEADER % 0) + READ_BYTES + 1)

        def read_bare() -> None:
            bare.sendall(b"CURVe?\n")
            view = memoryview(room)
            while view:
                view = view[bare.recv_into(view) :]

        def write_bare() -> None:
            bare.sendall(b"DATA " + HEADER % WRITE_BYTES)
            bare.sendall(block.data.cast("B"))
            bare.sendall(b"\n")
            bare.recv(2)

        for what, size, ours, other in (
            ("a block read", READ_BYTES, lambda: link.read_block("CURVe?", codes), read_bare),
            ("a block written", WRITE_BYTES, lambda: link.query_block("DATA ", block), write_bare),
        ):
            of_link, of_bare = interleaved(ours, other, repetitions=REPETITIONS)
            yield moved(what, size, of_link.wall_s, of_bare.wall_s)
        (asked,) = interleaved(lambda: link.query("*OPC?"), repetitions=QUERIES)
        yield Row("a query through VisaLink", asked.wall_s * 1e6, "us", processor=asked.processor_s * 1e6)
        link.close()


def uploads() -> Iterator[Row]:
    """Pictures as they are drawn, block by block."""
    pictures = np.random.default_rng(0).integers(0, 256, (UPLOAD_BLOCK, *PICTURE), dtype=np.uint8)
    with peer() as address, connected(address) as bare:
        dmd = VialuxAlp(AlpOverVisa(link_to(address)))

        def load() -> None:
            dmd.load([pictures] * FILLED, FILLED * UPLOAD_BLOCK)

        def load_bare() -> None:
            for first in range(0, FILLED * UPLOAD_BLOCK, UPLOAD_BLOCK):
                bare.sendall(b"ALP:SEQPUT 1,%d,%d," % (first, UPLOAD_BLOCK) + HEADER % pictures.nbytes)
                bare.sendall(pictures.data.cast("B"))
                bare.sendall(b"\n")
                bare.recv(2)

        of_dmd, of_bare = interleaved(load, load_bare, repetitions=REPETITIONS)
        yield moved("pictures loaded into a DMD", FILLED * pictures.nbytes, of_dmd.wall_s, of_bare.wall_s)
        dmd.close()


def stock_clients() -> Iterator[Row]:
    """A setting and a query by plain PyVISA, by transport."""
    manager = pyvisa.ResourceManager("@py")
    with SimulatedBench() as bench:
        for transport, address in bench.resources["awg"].items():
            opened = manager.open_resource(address, read_termination="\n", write_termination="\n")
            awg = cast(MessageBasedResource, opened)

            def set_and_query(awg: MessageBasedResource = awg) -> None:
                awg.write("SOURce1:VOLTage 0.3")
                awg.query("SOURce1:VOLTage?")

            (found,) = interleaved(set_and_query, repetitions=QUERIES)
            yield Row(f"set and query by plain PyVISA, {transport}", found.wall_s * 1e6, "us")
            awg.close()


def rows() -> Iterator[Row]:
    """All of them."""
    yield from blocks()
    yield from uploads()
    yield from stock_clients()
