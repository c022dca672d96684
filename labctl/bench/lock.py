"""One bench, one holder: which process of this machine has an instrument open.

Each instrument is locked by its address and, once it has said who it is, by its serial number: under another name it is
the same. The supervisor inherits the locks, so that nobody opens a bench whose run was killed before it is dark.
"""

import getpass
import os
import socket
import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from datetime import UTC, datetime
from pathlib import Path

from pydantic import BaseModel, Field, ValidationError
from pyvisa import rname

from instruments.bench import Observer
from instruments.sections import SIMULATED
from instruments.values import Identity
from labctl.bench.lock_file import LockFile
from labctl.bench.recording.wire import Wire
from labctl.bench.station import Station
from labctl.errors import BenchInUse
from labctl.runs.live.events import EVENTS, EventReader

LOOPBACK = "localhost"
LATEST_BYTES = 1 << 14
"""The end of a run's events, which says how far it is."""
DARK_WITHIN_S = 10.0
"""How long a supervisor may take to make dark what a process that is gone has left, before it is named."""
LOOK_EVERY_S = 0.05


class Holder(BaseModel):
    """Who holds an instrument, what for, since when, and in which run if it has one."""

    process: int
    user: str = Field(max_length=100)
    task: str = Field(max_length=100)
    since: datetime
    run: str = Field("", max_length=1000)

    @property
    def is_there(self) -> bool:
        """Whether the process has not ended."""
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


class Hold(Observer):
    """The instruments that this process holds. It follows the bench to say which run it is, and who they are."""

    def __init__(self, task: str) -> None:
        """None yet; `task` is what the bench is opened for."""
        self._holder = Holder(process=os.getpid(), user=_user(), task=task, since=datetime.now(UTC))
        self._locks: dict[str, LockFile] = {}
        self._real: set[str] = set()

    def at(self, name: str, address: str) -> None:
        """Hold the instrument called `name`, which is at `address`.

        Raises:
            BenchInUse: another process has it.
        """
        place = place_of(address)
        if LOOPBACK not in place:
            self._real.add(name)
        self._take(name, place)

    def _take(self, name: str, key: str) -> None:
        if key in self._locks:
            return
        lock = LockFile(key)
        if told := _refused(lock, key):
            lock.close()
            raise _is_in_use(name, told)
        self._locks[key] = lock
        self._sign(lock)

    def identified(self, name: str, identity: Identity) -> None:
        """Hold the instrument by its serial number too, unless it is a program of this machine: these all have one.

        Raises:
            BenchInUse: another process has it, at another address.
        """
        if identity.serial.strip("0 ") and name in self._real:
            self._take(name, f"{identity.manufacturer} {identity.model} {identity.serial}")

    def stored_in(self, directory: Path) -> None:
        """Say that it is this run."""
        self._holder = self._holder.model_copy(update={"run": str(directory.absolute())})
        for lock in self._locks.values():
            self._sign(lock)

    @property
    def descriptors(self) -> tuple[int, ...]:
        """What a process inherits to hold the instruments as long as itself."""
        return tuple(lock.descriptor for lock in self._locks.values())

    def close(self) -> None:
        """Let go; what a supervisor still holds is nobody's."""
        for lock in self._locks.values():
            lock.write(b"")
            lock.close()

    def _sign(self, lock: LockFile) -> None:
        lock.write(self._holder.model_dump_json().encode())


@contextmanager
def held_alone(address: str, task: str) -> Iterator[None]:
    """Hold what is at one address for the block.

    Raises:
        BenchInUse: another process has it.
    """
    hold = Hold(task)
    try:
        hold.at(address, address)
        yield
    finally:
        hold.close()


@contextmanager
def held(station: Station, task: str, wire: Wire = Wire(), also: Iterable[Station] = ()) -> Iterator[Hold]:
    """Hold the instruments of `station` for the block, but those that are simulated in this process or replayed.

    task: what for, in words. also: further stations whose instruments are held.

    Raises:
        BenchInUse: another process has one of them; says who, which run, since when and how long still.
    """
    hold = Hold(task)
    try:
        for name, address in _addresses(wire, station, *also):
            hold.at(name, address)
        yield hold
    finally:
        hold.close()


def in_use(station: Station, wire: Wire = Wire()) -> str:
    """Which instrument of `station` another process has just now, and who it is; empty if none. Holds nothing."""
    try:
        refuse_in_use(station, wire)
    except BenchInUse as error:
        return str(error)
    return ""


def refuse_in_use(station: Station, wire: Wire = Wire()) -> None:
    """Before anything is loaded that takes long: what `held` would refuse just now. Holds nothing.

    Raises:
        BenchInUse: another process has one of the instruments.
    """
    for name, address in _addresses(wire, station):
        with closing(LockFile(place_of(address))) as lock:
            if not lock.lock() and (holder := _holder(lock)) is not None:
                raise _is_in_use(name, holder.in_words())


def _is_in_use(name: str, told: str) -> BenchInUse:
    return BenchInUse(f"{name} is in use: {told}", told)


def _addresses(wire: Wire, *stations: Station) -> Iterator[tuple[str, str]]:
    for station in stations if wire.replay is None else ():
        by_hand = station.by_hand
        for name, address in station.addresses.items():
            if address != SIMULATED and name not in by_hand:
                yield name, address


def place_of(address: str) -> str:
    """Where an address leads, however it is written.

    Example:
        >>> from labctl.bench.lock import place_of
        >>> place_of("tcpip0::localhost::4000::socket") == place_of("TCPIP::127.0.0.1::4000::SOCKET")
        True
    """
    try:
        found = rname.ResourceName.from_string(address.upper())
    except rname.InvalidResourceName:
        return address.casefold()
    match found:
        case rname.TCPIPInstr():
            parts = _numeric(found.host_address), found.lan_device_name
        case rname.TCPIPSocket():
            parts = _numeric(found.host_address), found.port
        case _:
            return str(found).casefold()
    return " ".join(parts).casefold()


def _numeric(host: str) -> str:
    name, comma, port = host.partition(",")  # of VXI-11 without a port mapper
    try:
        found = {str(one[4][0]) for one in socket.getaddrinfo(name, None, type=socket.SOCK_STREAM)}
    except OSError:  # nobody has this name
        return host
    return (LOOPBACK if found & {"127.0.0.1", "::1"} else min(found)) + comma + port


def _user() -> str:
    try:
        return getpass.getuser()
    except (OSError, KeyError):  # a number without a name
        return "somebody"


def _refused(lock: LockFile, key: str) -> str:
    """Why `lock` is not to be had; empty when it is locked now.

    Waits for a supervisor that makes dark what a process that is gone has left; not for one that is there.
    """
    give_up = time.monotonic() + DARK_WITHIN_S
    while not lock.lock():
        if (holder := _holder(lock)) is not None:
            return holder.in_words()
        if time.monotonic() >= give_up:
            return _left_behind(key)
        time.sleep(LOOK_EVERY_S)
    return ""


def _holder(lock: LockFile) -> Holder | None:
    """Who holds it; None for one that has ended, or writes its note just now."""
    try:
        found = Holder.model_validate_json(lock.note)
    except (OSError, ValidationError):
        return None
    return found if found.is_there else None


def _left_behind(key: str) -> str:
    return (
        f"what used it ({key}) was ended with light on, and its supervisor still tries to switch the laser off: check "
        f"that the laser is dark, and plug its cable in"
    )


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
