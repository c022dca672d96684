"""Who has an instrument of this machine's benches just now, and where an address leads.

What a second command needs to be refused: it is loaded in a moment, and neither opens nor holds anything.
"""

import os
import re
import socket
import sys
from collections.abc import Iterable
from contextlib import closing
from datetime import datetime
from pathlib import Path

from pydantic import BaseModel, Field, ValidationError

from labctl.bench.lock_file import LockFile
from labctl.errors import BenchInUse
from labctl.runs.live.events import EVENTS, EventReader

LOOPBACK = "localhost"
LATEST_BYTES = 1 << 14
"""The end of a run's events, which says how far it is."""
OVER_TCP = re.compile(
    r"tcpip\d*::(?P<host>[^:]+)(?:::(?P<port>\d+)::socket|(?:::(?!instr$)(?P<device>[^:]+))?(?:::instr)?)",
    re.IGNORECASE,
)
SERIAL_PORT = re.compile(r"asrl(?P<path>/.+?)(?:::instr)?", re.IGNORECASE)
NUMBER = re.compile(r"0x[0-9a-f]+|\d+", re.IGNORECASE)
HISLIP = re.compile(r"(hislip\d+),4880")
"""The port that it has by itself."""
USB_SERIAL_NUMBER = 3
"""Its place in an address: the only part that is a name, also where it looks like a number."""


class Holder(BaseModel):
    """Who holds an instrument, what for, since when, and in which run if it has one; no `process` once it let go."""

    process: int | None
    user: str = Field(max_length=100)
    task: str = Field(max_length=100)
    since: datetime
    run: str = Field("", max_length=1000)

    @property
    def is_there(self) -> bool:
        """Whether the process has neither let go nor ended."""
        if self.process is None:
            return False
        if sys.platform == "win32":  # its lock falls with it
            return True
        try:
            os.kill(self.process, 0)
        except ProcessLookupError:
            return False
        except OSError:  # somebody else's
            pass
        return True

    def in_words(self) -> str:
        """Who, which run, since when, how long still, and what to do."""
        who = f"{self.task}, process {self.process} of {self.user}, since {self.since:%d %b %H:%M:%S} UTC"
        if not self.run:
            return f"{who}: wait for it"
        return f"{who}{_how_far(Path(self.run))}: wait for it, or end it: labctl stop {self.run}"


def refuse_in_use(addresses: Iterable[tuple[str, str]]) -> None:
    """What `labctl.bench.lock.held` would refuse just now. Holds nothing.

    addresses: name of an instrument, and its address.

    Raises:
        BenchInUse: another process has one of them; says who, which run, since when and how long still.
    """
    for name, address in addresses:
        with closing(LockFile(place_of(address))) as lock:
            if not lock.lock() and (found := holder(lock)) is not None:
                raise is_in_use(name, found.in_words())


def is_in_use(name: str, told: str) -> BenchInUse:
    """The refusal of the instrument called `name`; `told` is who has it."""
    return BenchInUse(f"{name} is in use: {told}", told)


def holder(lock: LockFile) -> Holder | None:
    """Who holds it; None for one that has ended, or writes its note just now."""
    found = latest_holder(lock)
    return found if found is not None and found.is_there else None


def latest_holder(lock: LockFile) -> Holder | None:
    """Who holds it, or held it last; None where there is no such note."""
    try:
        return Holder.model_validate_json(lock.note)
    except (OSError, ValidationError):
        return None


def place_of(address: str) -> str:
    """Where an address leads, however it is written.

    Example:
        >>> from labctl.bench.holder import place_of
        >>> place_of("tcpip0::localhost::4000::socket") == place_of("TCPIP::127.0.0.1::4000::SOCKET")
        True
    """
    if (found := OVER_TCP.fullmatch(address)) is not None:
        at = HISLIP.sub(r"\1", _plain(found["port"] or found["device"] or "inst0").casefold())
        return f"{_numeric(found['host']).casefold()} {at}"
    if (found := SERIAL_PORT.fullmatch(address)) is not None:
        return f"asrl{os.path.realpath(found['path'])}"

    from pyvisa import rname  # takes longer than all else that a refusal needs

    try:
        parts = str(rname.ResourceName.from_string(address.upper())).casefold().split("::")
    except rname.InvalidResourceName:
        return address.casefold()
    return "::".join(part if place == USB_SERIAL_NUMBER else _plain(part) for place, part in enumerate(parts))


def _plain(text: str) -> str:
    """With every number as a decimal one, without zeros in front."""
    return NUMBER.sub(lambda found: str(int(found[0], 16 if found[0][1:2] in "xX" else 10)), text)


def _numeric(host: str) -> str:
    name, comma, port = host.partition(",")  # of VXI-11 without a port mapper
    try:
        found = {str(one[4][0]) for one in socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)}
    except OSError:  # nobody has this name
        return host
    return (LOOPBACK if found & {"127.0.0.1", "::1"} else min(found)) + comma + _plain(port)


def _how_far(run: Path) -> str:
    latest = EventReader(run / EVENTS, last_bytes=LATEST_BYTES).read()
    for event in reversed(latest):
        match event.fields:
            case {"what": _}:  # of an upload
                continue
            case {"done": int(done), "total": int(total), "remaining_s": int(left) | float(left)}:
                return f", {done} of {total} records, about {max(left, 1):.0f} s more"
            case {"done": int(done), "total": int(total)}:
                return f", {done} of {total} records"
    return ""
