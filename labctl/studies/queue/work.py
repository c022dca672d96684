"""Carrying a queue out: each item is a `labctl` of its own, so that it leaves nothing to the next but a dark bench."""

import hashlib
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from os.path import isfile
from pathlib import Path
from typing import Any

from labctl.bench.lock_file import LockFile
from labctl.bench.own_files import is_own, remember
from labctl.bench.signals import STOPS, Interruption
from labctl.errors import BenchInUse, RunError, UsageError
from labctl.printable import typed
from labctl.runs import asking
from labctl.runs.format.layout import RunPaths
from labctl.runs.live.control_file import Word, word_in
from labctl.runs.live.owner import writer_of
from labctl.runs.queue import Item, Queue, State, Wish
from labctl.runs.sweep import is_sweep
from protocols.own_file import SUFFIX

COMMANDS = ("run", "sweep")
NO_MEASUREMENT = ("--dry-run", "--help")
LOOK_EVERY_S = 0.2
"""How often somebody's wish is looked for while an item runs."""
LOOKED_S, AGAIN_S = 0.5, 0.01
"""Longer than anybody takes to `settle` a queue, and how often it is tried meanwhile to have it."""
INTERRUPTED = frozenset({130, *(-number for number in STOPS)})
"""How an item ends that was interrupted: by its own status, or by the signal that came while it was starting."""
STATION = "--station"
KEPT_OPTIONS = {STATION: 1, "--data": 1, "--scheduler": 1, "--arm": 0, "--attended": 0}
"""Options that going on with a run or sweep needs again, and how many words each is followed by."""


class OnFailure(StrEnum):
    """What becomes of the rest of a queue when an item fails."""

    STOP = "stop"
    GO_ON = "go-on"


@dataclass(frozen=True)
class Worked:
    """What became of the items of a queue, and whether some still wait."""

    done: int
    failed: int
    waiting: int


def forecast(words: Sequence[str]) -> dict[str, Any]:
    """What the command of an item would do, by its own `--dry-run`, and of which `files`: path -> digest.

    Raises:
        UsageError: it is neither a run nor a sweep, or is refused; the line is its own.
    """
    if not words or words[0] not in COMMANDS:
        raise UsageError("a queue takes runs and sweeps: 'labctl queue add run image-readout --set images=400'")
    if asked := next((word for word in words if word in NO_MEASUREMENT), None):
        raise UsageError(f"{asked}: nothing would be measured: leave it out")
    files = _files(words, Path.cwd())
    digests = {str(path): _digest(path) for path in files}
    command = _command([words[0], "--dry-run", "--json", *words[1:]])  # in front, where nothing takes it for its own
    done = subprocess.run(command, capture_output=True, text=True, stdin=subprocess.DEVNULL, check=False)  # noqa: S603
    found = _said(done.stdout)
    if done.returncode:
        raise UsageError(str(found.get("error", done.stderr.strip() or "the command is refused")))
    if not found["armed"]:
        raise UsageError("the laser is not armed, and nobody will be there to do so: add the command with --arm")
    for path in filter(_is_protocol, files):
        remember(path)
    return found | {"files": digests}


def work(queue: Queue, on_failure: OnFailure, interruption: Interruption, tell: Callable[[str], None]) -> Worked:
    """Carry out what waits, and what is added meanwhile, until nothing does or somebody wants it to end.

    What ran when an earlier process died goes on where it stopped. An item that is interrupted waits again.

    Raises:
        BenchInUse: another process carries this queue out, or an item of one that was killed is still under way.
    """
    done = failed = 0
    with _alone(queue), closing(_lock_of_items(queue)) as inherited:
        if left := [item for item in _put_back(queue, inherited) if item.state is State.RUNNING]:
            raise BenchInUse(
                f"{left[0].directory}: item {left[0].number} is still under way, though whoever carried the queue out "
                f"is gone: wait for it, or stop it by 'labctl stop'"
            )
        while not interruption.requested and not queue.wishes and (item := queue.claim()) is not None:
            tell(f"{item.number}: labctl {typed(*item.words)}")
            status, message = _carried_out(item, queue, inherited)
            if status == 0:
                queue.end(item.number, State.DONE)
                done += 1
            elif status in INTERRUPTED or interruption.requested:  # Ctrl-C comes to both
                queue.end(item.number, State.WAITING)
                break
            else:
                queue.end(item.number, State.FAILED, message)
                tell(f"{item.number} failed: {message}")
                failed += 1
                if on_failure is OnFailure.STOP:
                    break
    return Worked(done, failed, sum(item.state is State.WAITING for item in queue.items()))


def ask(queue: Queue, wish: Wish) -> None:
    """Ask whoever carries a queue out for something.

    Raises:
        UsageError: no process of this machine does.
    """
    with closing(_lock(queue)) as lock, suppress(BenchInUse):  # of another user
        if lock.lock():
            raise UsageError(f"{queue.folder}: no process of this machine carries this queue out: nothing to stop")
    queue.ask(wish)


def settle(queue: Queue) -> list[Item]:
    """The items of a queue; what ran when whoever carried it out died waits again, unless it goes on by itself."""
    items = queue.items()
    if any(item.state is State.RUNNING for item in items):
        with suppress(BenchInUse), closing(_lock(queue)) as lock:  # of another user, who will say so himself
            if lock.lock():
                with closing(_lock_of_items(queue)) as inherited:
                    return _put_back(queue, inherited)
    return items


def _put_back(queue: Queue, inherited: LockFile) -> list[Item]:
    """What ran waits again, unless it goes on by itself: then it has the lock that its process has `inherited`.

    Windows lets none inherit it: there an item is known to go on as soon as its run or sweep has begun.
    """
    running = [item for item in queue.items() if item.state is State.RUNNING]
    alone = inherited.lock()
    queue.put_back([item for item in running if alone and writer_of(RunPaths(item.directory)) is None])
    return queue.items()


def _carried_out(item: Item, queue: Queue, inherited: LockFile) -> tuple[int, str]:
    """Exit status of an item's command, which has a lock as long as it runs, and its error."""
    begun = item.began and (RunPaths(item.directory).manifest.exists() or is_sweep(item.directory))
    files = {} if begun else item.plan.get("files", {})  # what has begun says itself what it goes on with
    changed = [path for path, digest in files.items() if _digest(Path(path)) != digest]
    changed += [path for path in filter(_is_protocol, _files(item.words, Path(item.cwd))) if not is_own(path)]
    if changed:
        return 1, f"{changed[0]}: is not what it was when this was added here: add it again"
    words = ["resume", str(item.directory), *_kept(item.words)] if begun else item.words
    try:
        process = subprocess.Popen(  # noqa: S603 -- labctl itself
            _command([words[0], "--json", *words[1:]]),
            stdout=subprocess.PIPE,
            stdin=subprocess.DEVNULL,
            text=True,
            cwd=item.cwd or None,
            pass_fds=() if sys.platform == "win32" else (inherited.descriptor,),
        )
    except OSError as error:
        return 1, f"{item.cwd}: where this was added is no folder any more ({error.strerror}): add it again"
    try:
        while True:
            try:
                out, _ = process.communicate(timeout=LOOK_EVERY_S)
            except subprocess.TimeoutExpired:
                with suppress(RunError):  # another program has the file just now: it is asked again
                    if Wish.STOP_NOW in queue.wishes:
                        _stop(item.directory)
                continue
            return process.returncode, str(_said(out).get("error", f"it ended with {process.returncode}"))
    except BaseException:
        process.terminate()
        process.communicate()
        queue.end(item.number, State.WAITING)
        raise


def _stop(directory: Path) -> None:
    """Ask the run or sweep of an item to end after its shot, as soon as it listens: an earlier word means nothing."""
    if writer_of(RunPaths(directory)) is not None and word_in(directory) is not Word.STOP:
        with suppress(OSError):  # it is asked again
            asking.tell(directory, Word.STOP)


def _files(words: Sequence[str], cwd: Path) -> list[Path]:
    """Of the words of a command typed in `cwd`, those that are files with a protocol, a sweep or a station.

    A note may end like one; what is no file is refused by the command itself.
    """
    named = [
        word.removeprefix(f"{STATION}=")
        for before, word in pairwise(["", *words])
        if before == STATION or word.startswith(f"{STATION}=") or word.endswith((SUFFIX, ".toml"))
    ]
    return [cwd / one for one in named if isfile(cwd / one)]


def _is_protocol(path: Path) -> bool:
    """Whether it would be executed."""
    return path.name.endswith(SUFFIX)


def _digest(path: Path) -> str:
    """Of the content of a file; empty where there is none any more that can be read."""
    with suppress(OSError):
        if isfile(path):  # a FIFO has no end
            with path.open("rb") as file:
                return hashlib.file_digest(file, "sha256").hexdigest()
    return ""


def _kept(words: Sequence[str]) -> list[str]:
    """Of the words of a command, the options that going on needs again."""
    kept: list[str] = []
    for place, word in enumerate(words):
        name, equals, _ = word.partition("=")
        if name in KEPT_OPTIONS:
            kept += words[place : place + 1 + (0 if equals else KEPT_OPTIONS[name])]
    return kept


def _command(words: Sequence[str]) -> list[str]:
    return [sys.executable, "-m", "labctl", *words]


def _said(text: str) -> dict[str, Any]:
    try:
        found = json.loads(text.strip().splitlines()[-1])
    except (ValueError, IndexError):
        return {}
    return found if isinstance(found, dict) else {}


@contextmanager
def _alone(queue: Queue) -> Iterator[None]:
    give_up = time.monotonic() + LOOKED_S
    with closing(_lock(queue)) as lock:
        while not lock.lock():
            if time.monotonic() >= give_up:
                raise BenchInUse(f"{queue.path}: another process carries this queue out: add to it, or stop it first")
            time.sleep(AGAIN_S)
        yield


def _lock(queue: Queue) -> LockFile:
    return LockFile(f"queue {queue.path.resolve()}")


def _lock_of_items(queue: Queue) -> LockFile:
    """Had by whoever has the queue's own lock, and by the process of its item, which may outlive him."""
    return LockFile(f"item of {queue.path.resolve()}")
