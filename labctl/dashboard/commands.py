"""Asking `labctl` for something in a process of its own: what it says as JSON."""

import asyncio
import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from labctl.dashboard.launcher import COMMAND
from labctl.printable import printable


async def answer(words: Sequence[str], environment: Mapping[str, str]) -> dict[str, Any]:
    """What the command prints as JSON; where it refuses, `error` in it is text that may be shown.

    Cancelled, it ends the process.

    Example: `await answer(["schema", "image-readout"], {})`.
    """
    process = await asyncio.create_subprocess_exec(
        *COMMAND,
        *words,
        "--json",
        env=os.environ | environment,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.PIPE,
    )
    try:
        printed, said = await process.communicate()
    finally:
        if process.returncode is None:
            process.kill()
    try:
        found = json.loads(printed)
    except ValueError:
        found = None
    if not isinstance(found, dict):
        told = said.decode(errors="replace").strip()
        found = {"error": told or f"labctl {words[0]} ended with {process.returncode}"}
    return found | {"error": printable(str(found["error"]))} if "error" in found else found
