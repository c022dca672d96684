"""Workers of a dask cluster that carry out tasks; the extra `cluster`.

A worker that dies has its task carried out by another one: dask sees to that. A scheduler that dies forgets everything:
when there is one again at its address, what it had is submitted again. A run appears in its place when it is whole, and
is not measured again if it is there, so that to be carried out twice costs time and nothing else.
"""

import asyncio
import logging
import os
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, Future, wait
from contextlib import AbstractContextManager, contextmanager, suppress
from functools import partial
from importlib import import_module
from pathlib import Path
from platform import node
from typing import Any, TypeVar
from urllib.parse import urlsplit
from uuid import uuid4

from labctl.errors import ClusterError, LabctlError, UsageError, one_line
from labctl.runs.format.provenance import sources_sha256, versions
from labctl.studies.tasks import CALLER, Interrupted, Workers, timed

Found = TypeVar("Found")

TRANSPORTS = ("tcp", "tls", "ucx", "ws", "wss")
"""Of dask between machines: what an address begins with."""
CONNECT_S = 10.0
"""To wait for an answer of the scheduler, and at the end for those of all workers."""
TELL_S = 0.5
"""Records are told the scheduler no oftener."""
COUNT_S = 1.0
"""The scheduler is asked for its workers no oftener."""
_stopped: set[str] = set()
"""On a worker: whose tasks should come to their end."""


def cluster(address: str, tell: Callable[[str], None]) -> Callable[[int], AbstractContextManager[Workers]]:
    """An engine: the workers of the scheduler at an address such as `tcp://192.0.2.7:8786`.

    tell: hears in one line that the scheduler is lost, and that it is there again.

    Raises:
        UsageError: that is no address, or dask.distributed is not installed.
    """
    if not _is_address(address):
        raise UsageError(
            f"--scheduler = {address!r}: is no address: write one such as tcp://192.0.2.7:8786, or local for the cores "
            f"of this machine"
        )
    try:
        _dask()
    except ImportError as error:
        raise UsageError('--scheduler needs dask: pip install "photonic-labctl[cluster]"') from error
    return partial(_connected, address, tell)


def _is_address(text: str) -> bool:
    """Whether it names host and port; without a transport dask takes TCP."""
    try:
        parts = urlsplit(text if "://" in text else f"tcp://{text}")
        return parts.scheme in TRANSPORTS and bool(parts.hostname) and bool(parts.port)
    except ValueError:
        return False


def _dask() -> Any:
    distributed = import_module("distributed")
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what is lost is told in one line
    return distributed


@contextmanager
def _connected(address: str, tell: Callable[[str], None], _tasks: int) -> Iterator[Workers]:
    connection = _Connection(address, tell)
    try:
        yield connection
    finally:
        connection.close()


class _Connection:
    """To a scheduler, made again when it was lost."""

    def __init__(self, address: str, tell: Callable[[str], None]) -> None:
        """Connect.

        Raises:
            ClusterError: nobody answers there.
        """
        self._records: dict[int, int] = {}  # by task: one that is carried out twice counts once
        self._address = address
        self._tell = tell
        self._lost = self._deserted = False
        self._workers, self._counted = 0, -COUNT_S
        self._name = uuid4().hex
        self._running: set[Future[Any]] = set()
        self._client = self._connect()

    def _connect(self) -> Any:
        try:
            asyncio.run(_reach(self._address))
            client = _dask().Client(self._address, timeout=CONNECT_S, set_as_default=False)
        except Exception as error:  # dask raises anything where another program answers
            why = "" if isinstance(error, OSError) else f" ({one_line(error)})"
            raise ClusterError(
                f"{self._address}: no scheduler answers{why}: start 'dask scheduler', or correct the address"
            ) from error
        client.subscribe_topic(self._name, self._hear)
        return client

    @property
    def records(self) -> int:
        """How many records were made in all tasks so far."""
        return sum(self._records.values())

    def _hear(self, event: tuple[float, tuple[int, int]]) -> None:
        task, records = event[1]
        self._records[task] = records

    def room(self, running: int) -> int:
        """A task for each worker, or one that waits for a worker; none while no scheduler answers."""
        try:
            if self._client.status == "closed":
                self._client = self._connect()
            elif self._client.status != "running":
                return self._wait()
            if time.monotonic() - self._counted >= COUNT_S:
                there = self._client.sync(self._client.scheduler.ncores, callback_timeout=CONNECT_S)
                self._workers, self._counted = len(there), time.monotonic()
        except (OSError, ClusterError):
            return self._wait()
        if self._lost:
            self._lost = False
            self._client.subscribe_topic(self._name, self._hear)  # a scheduler that was started anew knows of nobody
            self._tell(f"{self._address}: the scheduler is there again; what it lost begins anew")
        if not self._workers and not self._deserted:
            self._tell(f"{self._address}: the scheduler has no workers: start some; Ctrl-C keeps what is finished")
        self._deserted = not self._workers
        return max(self._workers, 1) - running

    def _wait(self) -> int:
        if not self._lost:
            self._lost = True
            self._tell(
                f"{self._address}: the scheduler is gone or stands still: start it again; Ctrl-C keeps what is finished"
            )
        return 0

    def submit(self, task: Callable[[], Found]) -> Future[tuple[Found, float]]:
        """Begin a task on some worker."""
        future: Future[tuple[Found, float]] = Future()
        self._running.add(future)
        future.add_done_callback(self._running.discard)
        given = self._client.submit(_carry_out, task, id(task), self._name, _made_by(), os.getcwd(), pure=False)
        self._client.loop.add_callback(_pass_on, given, future)
        return future

    def failure(self, error: Exception) -> Exception:
        """What a worker could not do, in one line; errors of labctl as they are."""
        if isinstance(error, LabctlError | Interrupted):
            return error
        return ClusterError(f"{self._address}: a worker failed ({type(error).__name__}: {error}): see its log")

    def close(self) -> None:
        """Have running tasks end, hear how, and leave; a worker that stands still is told, and not waited for."""
        with suppress(OSError):
            if self._client.status == "running" and self._client.run(
                _stop, self._name, on_error="ignore", callback_timeout=CONNECT_S
            ):
                wait(tuple(self._running), timeout=CONNECT_S)
        self._client.close()


async def _reach(address: str) -> None:
    """Return if a scheduler answers: dask's own client for threads waits for ever, and cannot be closed, if none does.

    Raises:
        Exception: whatever dask does.
    """
    client = _dask().Client(address, timeout=CONNECT_S, set_as_default=False, asynchronous=True)
    try:
        await asyncio.wait_for(client, CONNECT_S)
    finally:
        await client.close()


async def _pass_on(given: Any, future: Future[Found]) -> None:
    """Tell `future` what came of a task that dask was given; cancelled where it is lost.

    dask's own executor tells nothing where the scheduler dies while a result is on its way.
    """
    try:
        future.set_result(await given)
    except Exception as error:  # noqa: BLE001  # whoever waits for it raises it
        if given.status == "error" or not isinstance(error, OSError | CancelledError):
            future.set_exception(error)
        else:
            future.cancel()
            future.set_running_or_notify_cancel()


class _Client:
    """Whoever waits for a task, seen from a worker."""

    def __init__(self, worker: Any, task: int, name: str) -> None:
        """Of the tasks of this name; `task` is what it calls this one by."""
        self._worker = worker
        self._task = task
        self._name = name
        self._records = self._known = 0
        self._told = time.monotonic()

    def stopped(self) -> bool:
        """Whether it has left."""
        return self._name in _stopped

    def measured(self, records: int) -> None:
        """So many more, told now and then."""
        self._records += records
        if time.monotonic() - self._told >= TELL_S:
            self.tell()

    @property
    def scratch(self) -> Path:
        """The folder of the worker, which another worker clears when this one has died."""
        return Path(self._worker.local_directory)

    def tell(self) -> None:
        """Tell what was not told yet."""
        if self._records == self._known:
            return
        self._worker.log_event(self._name, (self._task, self._records))
        self._known, self._told = self._records, time.monotonic()


def _made_by() -> dict[str, str]:
    """What must be the same on a worker: packages, and labctl itself, which may have been changed under one version."""
    return versions() | {"sources of labctl": sources_sha256()}


def _stop(name: str) -> None:
    """On a worker."""
    _stopped.add(name)


def _carry_out(
    task: Callable[[], Found], number: int, name: str, wanted: dict[str, str], folder: str
) -> tuple[Found, float]:
    """On a worker, in the folder in which the command was typed, if it is there: paths may be relative to it."""
    worker = _dask().get_worker()
    if worker.state.nthreads != 1:
        raise ClusterError(f"{worker.address}: has {worker.state.nthreads} threads: start it with --nthreads 1")
    if (own := _made_by()) != wanted:
        differ = ", ".join(f"{one} {own.get(one)}, not {wanted[one]}" for one in wanted if own.get(one) != wanted[one])
        raise ClusterError(f"{worker.address}: has {differ}: install there what is installed here")
    if os.path.isdir(folder):
        os.chdir(folder)
    caller = _Client(worker, number, name)
    token = CALLER.set(caller)
    try:
        return timed(task)
    except LabctlError as error:
        error.add_note(f"on {node()}, worker {worker.address}")
        raise
    finally:
        CALLER.reset(token)
        caller.tell()
