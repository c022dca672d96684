"""One bench, one holder: which process of this machine has an instrument open.

Each instrument is locked by its address and, once it has said who it is, by its serial number: under another name it is
the same. The supervisor inherits the locks by address, so that nobody opens a bench whose run was killed before it is
dark; it starts before anybody has said who he is, and so has none by serial number.
"""

import os
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path

from instruments.bench import Observer
from instruments.sections import SIMULATED, USB, InstrumentSection
from instruments.values import Identity
from labctl.bench.holder import LOOPBACK, Holder, holder, is_in_use, latest_holder, place_of, refuse_in_use
from labctl.bench.lock_file import LockFile
from labctl.bench.recording.wire import Wire
from labctl.bench.station import Station
from labctl.errors import BenchInUse
from labctl.printable import typed
from labctl.user import user

DARK_WITHIN_S = 10.0
"""How long a supervisor may take to make dark what a process that is gone has left, before it is named."""
LOOK_EVERY_S = 0.05


class Hold(Observer):
    """The instruments that this process holds. It follows the bench to say which run it is, and who they are."""

    def __init__(self, task: str) -> None:
        """None yet; `task` is what the bench is opened for."""
        self._holder = Holder(process=os.getpid(), user=user() or "somebody", task=task, since=datetime.now(UTC))
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
            raise is_in_use(name, told)
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
        """Let go; what a supervisor still holds is nobody's, and says of which run it is left."""
        self._holder = self._holder.model_copy(update={"process": None})
        for lock in reversed(self._locks.values()):  # so that whoever asks for them in turn never gets a part of them
            self._sign(lock)
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
        refuse_in_use(_addresses(wire, station))
    except BenchInUse as error:
        return str(error)
    return ""


def _addresses(wire: Wire, *stations: Station) -> Iterator[tuple[str, str]]:
    for station in stations if wire.replay is None else ():
        by_hand = station.by_hand
        for name, address in station.addresses.items():
            if address != SIMULATED and name not in by_hand:
                yield name, address if address != USB else _behind_usb(station.section_of(name))


def _behind_usb(section: InstrumentSection) -> str:
    """Which device of a vendor's USB library, that has one address for all of them."""
    return f"{USB} {section.driver} {getattr(section, 'serial_number', None) or ''}"


def _refused(lock: LockFile, key: str) -> str:
    """Why `lock` is not to be had; empty when it is locked now.

    Waits for a supervisor that makes dark what a process that is gone has left; not for one that is there.
    """
    give_up = time.monotonic() + DARK_WITHIN_S
    while not lock.lock():
        if (found := holder(lock)) is not None:
            return found.in_words()
        if time.monotonic() >= give_up:
            return _left_behind(key, latest_holder(lock))
        time.sleep(LOOK_EVERY_S)
    return ""


def _left_behind(key: str, last: Holder | None) -> str:
    confirm = (
        f", or say that you see it dark: {typed('labctl', 'dark', last.run)}" if last is not None and last.run else ""
    )
    return (
        f"what used it ({key}) was ended with light on, and its supervisor still tries to switch the laser off: check "
        f"that the laser is dark, and plug its cable in{confirm}"
    )
