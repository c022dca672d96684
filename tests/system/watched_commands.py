"""Carry out commands one by one, each in a process forked from this one, and tell what it said and what it touched.

On standard input a JSON list of command lines; on standard output a line of JSON for each. What was touched are the
files that Python opened, the folders it made, and the connections and processes it began: Python's audit events.

Usage: `python -m tests.system.watched_commands`, which the tests carry out in a process that has loaded all of labctl.
"""

import json
import os
import sys
import tempfile
from collections.abc import Callable
from typing import Any

from labctl.commands.main import main as labctl

TOLD = ("open", "os.mkdir", "os.remove", "os.rename", "os.truncate", "socket.connect", "subprocess.Popen")


def carry_out(words: list[str], limit: Callable[[], None] = lambda: None) -> dict[str, Any]:
    with tempfile.TemporaryFile("w+b") as out, tempfile.TemporaryFile("w+b") as said, tempfile.TemporaryFile() as seen:
        child = os.fork()
        if not child:
            os.dup2(out.fileno(), 1)
            os.dup2(said.fileno(), 2)
            watch(seen.fileno())
            out.close()
            said.close()
            limit()
            try:
                labctl(words)
            except SystemExit as ended:
                sys.stdout.flush()
                os._exit(ended.code if isinstance(ended.code, int) else 1)
            except Exception:  # noqa: BLE001 - as the interpreter ends with it
                sys.excepthook(*sys.exc_info())
                sys.stderr.flush()
                os._exit(1)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        for file in (out, said, seen):
            file.seek(0)
        return {
            "command": words,
            "status": status,
            "out": out.read().decode(errors="surrogateescape"),
            "said": said.read().decode(errors="surrogateescape"),
            "touched": [json.loads(line) for line in seen.read().splitlines()],
        }


def watch(descriptor: int) -> None:
    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event in TOLD:
            os.write(descriptor, json.dumps([event, str(arguments[0])]).encode() + b"\n")

    sys.addaudithook(note)


def main() -> None:
    for command in json.load(sys.stdin):
        print(json.dumps(carry_out(command)), flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
