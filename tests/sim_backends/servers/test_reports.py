"""Reports on a raw socket: packets cut out of the stream, and replies that do not come as they should."""

import struct

import pytest

from instruments.errors import LinkError
from instruments.ti_dlpc900 import DRIVER, TiDlpc900, TiDlpc900Section
from sim_backends.faults.bench import FaultyBench
from sim_backends.faults.specification import read_fault
from sim_backends.servers.reports import ReportReader
from sim_backends.virtual.dlpc900.instrument import VirtualDlpc900
from tests.instruments.test_ti_dlpc900 import opening
from tests.sim_backends.virtual.watched import SMALL


def packet(command: int, data: bytes = b"", flags: int = 0x40) -> bytes:
    whole = struct.pack("<BBHH", flags, 1, len(data) + 2, command) + data
    return whole + bytes(-len(whole) % 64)


@pytest.mark.parametrize("at_once", [1, 63, 64, 100, 1000])
def test_packets_are_found_however_they_arrive(at_once: int) -> None:
    sent = [packet(0x1A1B, b"\3"), packet(0x1A2B, bytes(range(256)), flags=0), packet(0x1A0C, flags=0xC0)]
    stream, reader, found = b"".join(sent), ReportReader(), []
    for start in range(0, len(stream), at_once):
        piece = stream[start : start + at_once]
        reader.buffer()[: len(piece)] = piece
        found += reader.received(len(piece))
    assert [bytes(message.units[0].arguments[0]) for message in found] == sent  # type: ignore[arg-type]
    assert [message.units[0].header for message in found] == ["0x1A1B", "0x1A2B", "0x1A0C"]
    assert [message.queries for message in found] == [True, False, True]
    reader.buffer()[:5] = b"*IDN?"
    assert reader.received(5) == []
    reader.clear()
    assert reader.end() == []


@pytest.mark.parametrize(
    ("fault", "told"),
    [
        ("no-reply@0x0206?", "no answer to command 0x0206"),
        ("late@0x0206?", "no answer to command 0x0206"),
        ("lost-before@0x0206?", "it hung up"),
        ("lost-inside@0x0206?,byte=7", "it hung up"),
    ],
)
def test_a_reply_that_does_not_come_is_a_lost_link_once(fault: str, told: str) -> None:
    with FaultyBench([read_fault(f"dmd:{fault}")], SMALL, dmd=VirtualDlpc900) as bench:
        address = bench.resources["dmd"]["socket"]
        dmd = DRIVER.open(TiDlpc900Section(driver="ti-dlpc900", timeout=1), opening(address))
        assert isinstance(dmd, TiDlpc900)
        with pytest.raises(LinkError, match=told):
            dmd.identify()
        assert dmd.identify().firmware == "LCR6500 simulated 6.0.0"
        dmd.close()
