"""`labctl sim serve --fault`: clients of others meet the faults they ask for, at the message they ask for."""

import json
import signal
import socket
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest
import pyvisa

from labctl.commands.main import main
from sim_backends.faults.catalogue import BEFALL

Served = Callable[..., dict[str, Any]]


@pytest.fixture
def served(labctl_command: tuple[str, ...]) -> Iterator[Served]:
    """Serves a bench with faults and gives its resources; says at the end what stood on standard error."""
    with ExitStack() as stack:

        def serve(*faults: str, told: str) -> dict[str, Any]:
            asked = [argument for fault in faults for argument in ("--fault", fault)]
            server = stack.enter_context(
                subprocess.Popen(
                    [*labctl_command, "sim", "serve", "--json", *asked],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.PIPE,
                    text=True,
                )
            )

            def end() -> None:
                server.send_signal(signal.SIGTERM)
                rest, errors = server.communicate(timeout=30)
                assert (rest, server.returncode) == ("", 0)
                assert errors.splitlines() == told.splitlines()

            stack.callback(end)
            assert server.stdout is not None
            resources: dict[str, Any] = json.loads(server.stdout.readline())["resources"]
            return resources

        yield serve


def client(resource: str) -> Any:
    """A plain pyvisa session, as anybody's program has it."""
    session: Any = pyvisa.ResourceManager("@py").open_resource(resource, read_termination="\n", write_termination="\n")
    session.timeout = 500
    return session


@pytest.mark.parametrize("transport", ["socket", "hislip", "vxi11"])
def test_the_third_of_these_questions_is_not_answered(transport: str, served: Served) -> None:
    address = served("scope:no-reply@*idn?,nth=3", told="fault at scope: the reply does not come")["scope"][transport]
    with client(address) as scope:
        for _ in range(2):
            assert "DPO72504DX" in scope.query("*IDN?")
        assert scope.query("*OPC?") == "1"
        with pytest.raises(pyvisa.VisaIOError, match="VI_ERROR_TMO"):
            scope.query("*IDN?")
        assert "DPO72504DX" in scope.query("*IDN?")


def test_faults_befall_several_instruments_and_spare_the_others(served: Served) -> None:
    told = "fault at laser: connections are refused from the beginning\nfault at awg: only the reply's line feed comes"
    found = served("awg:empty@CLOC:SRAT?,times=2", "laser:nobody-there", told=told)
    with client(found["awg"]["socket"]) as awg:
        assert [awg.query("CLOCk:SRATe?") for _ in range(3)] == ["", "", "2.5000000000E+10"]
    with client(found["patch_panel"]["socket"]) as switch:
        assert switch.query("*IDN?")
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", int(found["laser"]["socket"].split("::")[2])))


def test_a_reply_breaks_off_at_the_byte_that_was_asked_for(served: Served) -> None:
    found = served("scope:lost-inside@*IDN?,byte=5", told="fault at scope: the link ends inside the reply")
    with client(found["scope"]["socket"]) as scope:
        scope.write("*IDN?")
        assert scope.read_bytes(5) == b"TEKTR"
    with client(found["scope"]["socket"]) as scope:
        assert scope.query("*IDN?").startswith("TEKTRONIX")


@pytest.mark.parametrize(
    ("asked", "told"),
    [
        ("scpe:dead", "no instrument 'scpe': one of awg, scope, laser, dmd, patch_panel"),
        ("amplifier:dead", "no amplifier on this bench: write a section [amplifier] into the station file"),
        ("dmd:interlock", "no fault 'interlock' of dmd: one of nobody-there, refused, lost-before, "),
        ("scope", "write INSTRUMENT:FAULT[@MESSAGE][,nth=N][,times=N][,byte=N], such as scope:no-reply@CURVe?,nth=3"),
        ("scope:dead,after=3", "',after=3'"),
        ("scope:dead,nth=0", "'nth=0': messages are counted from 1"),
        ("scope:no-reply,times=0", "'times=0': messages are counted from 1"),
        ("scope:dead,times=3", "dead lasts from its message on: leave out times="),
        ("scope:dead,byte=3", "byte= says where a reply breaks off: only with lost-inside"),
        ("scope:nobody-there@*IDN?", "nobody-there comes before any message: leave out what follows it"),
    ],
)
def test_what_is_no_fault_is_refused_in_a_line_that_names_what_is_known(
    asked: str, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["sim", "serve", "--fault", asked])
    error = capsys.readouterr().err
    assert (ended.value.code, error.count("\n")) == (2, 1)
    assert told.strip("',") in error


def test_every_fault_is_listed(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["sim", "serve", "--fault", "list", "--json"])
    assert ended.value.code == 0
    listed = json.loads(capsys.readouterr().out)["faults"]
    told = {one["told"] for one in listed}
    assert told == {fault.told for rows in BEFALL.values() for faults, _ in rows for fault in faults.values()}
    assert {role for one in listed for role in one["instruments"]} == set(BEFALL)
