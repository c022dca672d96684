"""The whole simulated bench, as stock clients reach it."""

import contextlib
import gc
import socket
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
import pyvisa
from pyvisa.resources import MessageBasedResource

from sim_backends.bench import SimulatedBench
from sim_backends.virtual.fibre_switch.instrument import VirtualFibreSwitch

ROLES = ["awg", "scope", "laser", "dmd", "patch_panel"]


@contextmanager
def opened(resource: str) -> Iterator[MessageBasedResource]:
    manager = pyvisa.ResourceManager("@py")
    client = manager.open_resource(resource, read_termination="\n", write_termination="\n", timeout=20_000)
    assert isinstance(client, MessageBasedResource)
    try:
        yield client
    finally:
        client.close()


def free_base() -> int:
    """A port below which nothing is known to listen, with room above."""
    for base in range(42_000, 60_000, 40):
        with contextlib.ExitStack() as taken, contextlib.suppress(OSError):
            for port in (*range(base, base + 5), *range(base + 10, base + 15), *range(base + 20, base + 22)):
                taken.enter_context(socket.create_server(("127.0.0.1", port)))
            return base
    raise AssertionError("no free ports")


def test_every_instrument_answers_on_each_transport() -> None:
    with SimulatedBench() as bench:
        assert list(bench.resources) == ROLES
        for role, addresses in bench.resources.items():
            assert list(addresses) == ["socket", "hislip"] + ["vxi11"] * (role in ("awg", "scope"))
            identities = set()
            for resource in addresses.values():
                with opened(resource) as client:
                    identities.add(client.query("*IDN?"))
            assert len(identities) == 1, role
    gc.collect()  # a socket left open is reported here


def test_ports_that_were_asked_for() -> None:
    base = free_base()
    with SimulatedBench(port_base=base) as bench:
        for rank, role in enumerate(ROLES):
            expected = {
                "socket": f"TCPIP0::127.0.0.1::{base + rank}::SOCKET",
                "hislip": f"TCPIP0::127.0.0.1::hislip0,{base + 10 + rank}::INSTR",
                "vxi11": f"TCPIP0::127.0.0.1,{base + 20 + rank}::inst0::INSTR",
            }
            assert bench.resources[role].items() <= expected.items()
        with pytest.raises(OSError, match="choose another port"):
            SimulatedBench(port_base=base).start()
        with pytest.raises(RuntimeError, match="stop it"):
            bench.start()
    bench.stop()


def test_stopping_ends_connections_and_starting_again_works() -> None:
    bench = SimulatedBench()
    bench.start()
    port = int(bench.resources["scope"]["socket"].split("::")[2])
    with socket.create_connection(("127.0.0.1", port), timeout=20) as client:
        client.sendall(b"*OPC?\n")
        assert client.recv(10) == b"1\n"
        bench.stop()
        assert client.recv(10) == b""
    bench.start()
    with opened(bench.resources["scope"]["hislip"]) as scope:
        assert scope.query("*OPC?") == "1"
    bench.stop()


def test_what_a_client_sets_changes_the_world() -> None:
    with SimulatedBench(twin_seed=7) as bench:
        assert bench.world.twin_seed == 7
        with opened(bench.resources["patch_panel"]["socket"]) as switch:
            switch.write("ROUT:CLOS (@3!5)")
            assert switch.query("ROUT:CLOS? (@3!5,3!6)") == "1,0"


def test_an_error_inside_an_instrument_is_raised_when_the_bench_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_instrument: VirtualFibreSwitch) -> str:
        raise ZeroDivisionError("virtual instrument")

    monkeypatch.setattr(VirtualFibreSwitch, "identity", fail)
    bench = SimulatedBench()
    bench.start()
    port = int(bench.resources["patch_panel"]["socket"].split("::")[2])
    with socket.create_connection(("127.0.0.1", port), timeout=20) as client:
        client.sendall(b"*IDN?\n")
        assert client.recv(10) == b""
    with pytest.raises(ZeroDivisionError, match="virtual instrument"):
        bench.stop()
    bench.stop()
