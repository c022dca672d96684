"""`labctl sim serve`: where it listens, and what it says about that."""

import socket

import pytest

from labctl.commands.main import main


def refusal(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    with pytest.raises(SystemExit) as ended:
        main(["sim", "serve", *arguments])
    assert ended.value.code == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    return captured.err


def test_an_address_that_is_none(capsys: pytest.CaptureFixture[str]) -> None:
    assert "give an address of this machine" in refusal(capsys, "--host", "bench.example.org")


def test_an_address_of_another_machine(capsys: pytest.CaptureFixture[str]) -> None:
    said = refusal(capsys, "--host", "192.0.2.1")
    assert "anyone who reaches 192.0.2.1" in said
    assert "cannot listen on 192.0.2.1" in said


def test_a_port_that_is_taken(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        said = refusal(capsys, "--port-base", str(taken.getsockname()[1]))
    assert said.startswith("labctl: --host, --port-base: cannot listen on 127.0.0.1")
    assert "anyone" not in said
