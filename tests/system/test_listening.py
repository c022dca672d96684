"""Where `labctl sim serve` listens, in a process of its own."""

import json
import signal
import subprocess

import pytest


@pytest.mark.parametrize(("host", "warns"), [("127.0.0.2", False), ("0.0.0.0", True)])  # noqa: S104
def test_only_an_address_beyond_this_machine_is_warned_of(
    host: str, warns: bool, labctl_command: tuple[str, ...]
) -> None:
    command = [*labctl_command, "sim", "serve", "--json", "--host", host]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        resources = json.loads(server.stdout.readline())["resources"]
        server.send_signal(signal.SIGTERM)
        _, said = server.communicate(timeout=30)
    assert server.returncode == 0
    assert resources["scope"]["vxi11"].startswith(f"TCPIP0::{host},")
    assert said.count("\n") == warns
    assert ("anyone who reaches" in said) == warns
