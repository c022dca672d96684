"""A simulated bench in a process of its own."""

import json
import os
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_SERVE = (sys.executable, "-c", "from labctl.commands.main import main; main()")


@contextmanager
def served(*options: str) -> Iterator[dict[str, dict[str, str]]]:
    """Addresses of a bench served by the command in `LABCTL` (by this interpreter without it)."""
    command = shlex.split(os.environ["LABCTL"]) if "LABCTL" in os.environ else _SERVE
    with subprocess.Popen([*command, "sim", "serve", "--json", *options], stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        try:
            yield json.loads(server.stdout.readline())["resources"]
        finally:
            server.send_signal(signal.SIGTERM)
            server.communicate(timeout=30)
    assert server.returncode == 0
