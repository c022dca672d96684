"""Processes of labctl that begin as copies of one that has loaded it: to load it anew takes each one or two seconds.

A copy has what `subprocess.Popen` was asked for: number, files, folder, environment, session; it is a child of whoever
asked, ends like any process, and starts others in the same way. It differs from one that starts for a user in that all
is loaded already: tests of how something starts, or of what a process holds, have the
fixture `started_anew`.

The one that is copied must have no thread but one, so it is none of those that ask: they have it started beside them.
"""

import asyncio
import atexit
import ctypes
import gc
import importlib
import inspect
import multiprocessing.util
import os
import pickle
import pkgutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from importlib.machinery import PathFinder
from pathlib import Path
from typing import Any, NamedTuple, NoReturn
from unittest.mock import patch

from labctl.bench import supervision
from labctl.dashboard import launcher
from tests.checkout import ROOT

TYPED, SUPERVISOR, DASK = launcher.COMMAND[-1], f"from {supervision.COMMAND[-1]} import main; main()", "dask.__main__"
WATCHED = "tests.system.watched_commands"
KNOWN: Mapping[tuple[str, ...], str] = {
    ("-m", "labctl"): TYPED,
    ("-c", TYPED): TYPED,
    launcher.COMMAND[1:]: TYPED,
    supervision.COMMAND[1:]: SUPERVISOR,
    ("-m", "dask"): f"from {DASK} import main; main()",
    ("-m", WATCHED): f"from {WATCHED} import main; main()",
}
"""How processes of labctl, of dask and of tests of its commands are started, and what each carries out."""
WORKERS = ("from multiprocessing.spawn import", "from multiprocessing.forkserver import")
"""What the processes carry out that Python's own pools start, up to the numbers of their files."""
FROM_FOLDER = ""
"""What `sys.path` begins with unless `-P` forbids it."""
AT_START = ("PYTHON", "LD_", "OMP_", "OPENBLAS_", "LANG", "LC_", "TZ", "MPL")
"""What the variables begin with that are read when a process starts: with other ones than here, it starts anew."""
ADDED = "PYTHONPATH"
"""The one of them of which a copy takes what it adds, unless that would be taken in place of what is loaded."""
LOADED = ("labctl", "protocols", "instruments", "sim_backends")
NOT_LOADED = ("sim_backends.world.card", "labctl.__main__")
"""torch, and what works when it is loaded."""
MESSAGE, FILES = 1 << 20, 64
"""The largest message, bytes, and the largest number of files that come with it."""
AWAY = 512
"""Descriptors that a copy keeps to itself are at least this."""
PR_SET_CHILD_SUBREAPER = 36

STARTED_ANEW, SPAWNED_ANEW = subprocess.Popen, multiprocessing.util.spawnv_passfds


class Asked(NamedTuple):
    """A process that is to be: the numbers of the files that come with it, in their order, and as Popen has it."""

    code: str
    words: tuple[str, ...]
    files: tuple[int, ...]
    folder: str
    environment: dict[str, str]
    own_session: bool
    from_folder: bool


class Source:
    """The process that is copied, for the one that asks it over `link`."""

    def __init__(self, link: socket.socket) -> None:
        """Nobody else asks over `link`; of a process that this one forks, the copies would not be children."""
        self.asker = os.getpid()
        self._link, self._lock = link, threading.Lock()
        self._reaper = ctypes.CDLL(None, use_errno=True).prctl

    def copy(self, asked: Asked, files: list[int]) -> int:
        """Begin a process, a child of this one: its number."""
        with self._lock:
            # Whose parent has ended goes to the next above that adopts: the copy's parent is one that ends at once.
            self._reaper(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
            try:
                socket.send_fds(self._link, [pickle.dumps(asked)], files)
                return int(self._link.recv(MESSAGE))
            finally:
                self._reaper(PR_SET_CHILD_SUBREAPER, 0, 0, 0, 0)


class ForkedPopen(subprocess.Popen[Any]):
    """`subprocess.Popen`, by a copy where that is the same."""

    source: Callable[[str], Source]

    def _execute_child(self, *given: Any) -> None:
        anew = super()._execute_child  # type: ignore[misc]
        started = inspect.signature(anew).bind(*given).arguments
        strange = any(started[name] for name in ("executable", "preexec_fn", "shell"))
        asked = None if strange else as_copy(started["args"], started["env"], started["pass_fds"])
        if asked is None:
            anew(*given)
            return
        asked = asked._replace(folder=os.path.abspath(started["cwd"] or "."), own_session=started["start_new_session"])
        ends = [started[name] for name in ("p2cread", "p2cwrite", "c2pread", "c2pwrite", "errread", "errwrite")]
        files = [number if end == -1 else end for number, end in enumerate((ends[0], ends[3], ends[5]))]
        self.pid = type(self).source(asked.code).copy(asked, [*files, *asked.files[3:]])
        self._child_created = True
        self._close_pipe_fds(*ends)  # type: ignore[attr-defined]


class AwaitedCopy:
    """What `asyncio.create_subprocess_exec` gives, as far as labctl uses it: uvloop starts processes by itself."""

    def __init__(self, *words: str, **how: Any) -> None:
        """Begin the process."""
        self._process = ForkedPopen(words, **how)
        self.kill = self._process.kill

    @classmethod
    async def begin(cls, *words: str, **how: Any) -> "AwaitedCopy":
        """The process, begun."""
        return cls(*words, **how)

    @property
    def returncode(self) -> int | None:
        """Exit status; None while it goes on."""
        return self._process.poll()

    async def communicate(self) -> tuple[bytes, bytes]:
        """All that it says on both streams."""
        said: tuple[bytes, bytes] = await asyncio.to_thread(self._process.communicate)
        return said


def spawned(path: Any, args: Sequence[Any], passfds: Sequence[int]) -> int:
    """`multiprocessing.util.spawnv_passfds`, by a copy where that is the same."""
    asked = as_copy([path, *args[1:]], None, passfds)
    if asked is None:
        return SPAWNED_ANEW(path, args, passfds)
    return ForkedPopen.source(asked.code).copy(asked, list(asked.files))


def as_copy(args: Any, env: Mapping[str, str] | None, files: Iterable[int]) -> Asked | None:
    """The copy that is what `args` would start, here; None where only a process that starts anew is."""
    if isinstance(args, str | bytes | os.PathLike):
        return None
    python, *words = map(os.fsdecode, args)
    known = next((known for known in KNOWN if tuple(words[: len(known)]) == known), None)
    if words[:1] == ["-c"] and words[1].startswith(WORKERS):
        known = ("-c", words[1])
    environment = dict(os.environ if env is None else env)
    if python != sys.executable or known is None or read_at_start(environment) != AS_STARTED or is_other(environment):
        return None
    code = KNOWN.get(known, known[-1])
    if ForkedPopen.source(code).asker != os.getpid():
        return None
    return Asked(
        code=code,
        words=tuple(words[len(known) :]),
        files=(0, 1, 2, *sorted(files)),
        folder=os.getcwd(),
        environment=environment,
        own_session=False,
        from_folder="-P" not in known,
    )


def read_at_start(environment: Mapping[str, str]) -> dict[str, str]:
    """The variables that are read when a process starts."""
    return {name: value for name, value in environment.items() if name.startswith(AT_START) and name != ADDED}


AS_STARTED = read_at_start(os.environ)


def added(environment: Mapping[str, str]) -> list[str]:
    """The folders that are searched for modules before all others."""
    return [folder for folder in environment.get(ADDED, "").split(os.pathsep) if folder]


def is_other(environment: Mapping[str, str]) -> bool:
    """Whether a module that is found without `PYTHONPATH` would be found elsewhere with it: it may be loaded."""
    elsewhere = (Path(folder) for folder in added(environment) if folder not in (str(ROOT), *sys.path))
    names = {path.name.partition(".")[0] for folder in elsewhere if folder.is_dir() for path in folder.iterdir()}
    return any(PathFinder.find_spec(name) is not None for name in names)


def copies(link: socket.socket) -> Asked:
    """Copy this process whenever that is asked for over `link`; returns in the copies alone, as what each was asked."""
    while True:
        message, files, _, _ = socket.recv_fds(link, MESSAGE, FILES)
        if not message:
            os._exit(0)
        heard, told = os.pipe()
        if not (between := os.fork()):
            if os.fork():
                os._exit(0)
            os.close(told)
            os.read(heard, 1)  # ends when it has its parent
            link.send(str(os.getpid()).encode())
            link.close()
            return begun(pickle.loads(message), files)  # noqa: S301 -- of our own
        for number in (heard, *files):
            os.close(number)
        os.waitpid(between, 0)
        os.close(told)


def begun(asked: Asked, files: list[int]) -> Asked:
    """Make this copy what it is to be; it has a copy of its own for what it starts. Returns in those too, as theirs.

    A supervisor starts nothing.
    """
    if asked.own_session:
        os.setsid()
    files = [os.dup2(number, AWAY + place, inheritable=False) for place, number in enumerate(files)]
    ours, theirs = (
        socket.socket(fileno=os.dup2(end.detach(), AWAY + FILES + place, inheritable=False))
        for place, end in enumerate(socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET))
    )
    os.closerange(3, AWAY)
    if asked.code != SUPERVISOR and not os.fork():
        ours.close()
        for number in files:
            os.close(number)
        nothing = os.open(os.devnull, os.O_RDWR)
        for number in range(3):
            os.dup2(nothing, number)
        return copies(theirs)
    theirs.close()
    for number, found in zip(asked.files, files, strict=True):
        os.dup2(found, number)
        os.close(found)
    source = Source(ours)
    ForkedPopen.source = lambda _code: source
    return asked


def prepare(asked: Asked) -> None:
    """Make of this copy what a process is that has just started."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.chdir(asked.folder)
    os.environ.clear()
    os.environ.update(asked.environment)
    time.tzset()
    sys.argv[1:] = asked.words
    place = sys.path.index(FROM_FOLDER)
    sys.path[place : place + 1] = [FROM_FOLDER] * asked.from_folder + added(asked.environment)
    sys.stdin = open(0, encoding=sys.stdin.encoding)  # noqa: SIM115
    sys.stdout = open(1, "w", encoding=sys.stdout.encoding, errors=sys.stdout.errors)  # noqa: SIM115
    sys.stderr = open(2, "w", 1, encoding=sys.stderr.encoding, errors=sys.stderr.errors)  # noqa: SIM115


def carry_out(code: str) -> NoReturn:
    """Carry out `code` and end as a process does, but for taking down what was loaded, which takes longer than most."""
    status: object = 0
    try:
        exec(code, vars(sys.modules["__main__"]))  # noqa: S102 -- what is typed behind -c
    except SystemExit as error:
        status = error.code
    except BaseException:  # noqa: BLE001 -- as the interpreter does
        sys.excepthook(*sys.exc_info())
        status = 1
    threading._shutdown()  # type: ignore[attr-defined]
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(int(str(status or 0)))


def load(code: str) -> None:
    """Load what carries `code` out: labctl, and what all benches have in common, unless it is the supervisor alone."""
    from instruments.units import quantity
    from labctl.bench.station import SIMULATED_STATION, USUAL

    if code == SUPERVISOR:
        importlib.import_module("labctl.bench.supervisor")
        for name in USUAL:
            SIMULATED_STATION.driver_of(name)
        return
    from labctl.runs.format.provenance import git_revision, versions
    from sim_backends.parameters import Parameters
    from sim_backends.world.twin import drawn_twin

    for package in LOADED:
        for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            if module.name not in NOT_LOADED:
                with suppress(ImportError):  # of an extra that is not installed
                    importlib.import_module(module.name)
    importlib.import_module(DASK)
    quantity("1 ns", "s")
    versions()
    git_revision()
    drawn_twin(Parameters(), SIMULATED_STATION.sim.twin_seed)


def serve(number: int, code: str) -> None:
    """Be the process that is copied for `code`, for whoever has the other end of the socket with this number."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for those who ask
    load(code)
    gc.collect()
    gc.freeze()
    subprocess.Popen = ForkedPopen  # type: ignore[misc]
    asyncio.create_subprocess_exec = AwaitedCopy.begin  # type: ignore[assignment]
    multiprocessing.util.spawnv_passfds = spawned
    asked = copies(socket.socket(fileno=number))
    prepare(asked)
    carry_out(asked.code)


@contextmanager
def forked() -> Iterator[None]:
    """Processes of labctl that this one starts inside the block are copies, on Linux."""
    if sys.platform != "linux":
        yield
        return
    with ExitStack() as stack:

        @cache
        def started(code: str) -> Source:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            command = [sys.executable, "-c", f"from {__name__} import serve; serve({theirs.fileno()}, {code!r})"]
            with theirs:
                process = STARTED_ANEW(command, cwd=ROOT, pass_fds=[theirs.fileno()], stdin=subprocess.DEVNULL)
            stack.enter_context(process)
            stack.callback(process.kill)
            return Source(stack.enter_context(ours))

        def source(code: str) -> Source:
            return started(SUPERVISOR if code == SUPERVISOR else TYPED)

        ForkedPopen.source = source
        with patch("subprocess.Popen", ForkedPopen), patch("multiprocessing.util.spawnv_passfds", spawned):
            yield


@contextmanager
def started_anew() -> Iterator[None]:
    """Inside the block, and inside that of `forked`, they start anew all the same."""
    with patch("subprocess.Popen", STARTED_ANEW), patch("multiprocessing.util.spawnv_passfds", SPAWNED_ANEW):
        yield
