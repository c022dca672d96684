"""Storing records while the bench goes on measuring."""

from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self

from instruments.values import Frames
from labctl.engine.profile import STORAGE_BESIDE, Stopwatch
from labctl.runs.format.layout import noted_on
from labctl.runs.write.writer import RunWriter


class Storage:
    """Stores records; a burst in a thread of its own, while the bench measures the next one.

    Attributes:
        kept: how many records are done, see `Progress`.
    """

    def __init__(self, writer: RunWriter, stopwatch: Stopwatch) -> None:
        """Store into `writer`."""
        self.kept = 0
        self._writer = writer
        self._stopwatch = stopwatch
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="storage")
        self._stored: Future[int] | None = None

    def keep(self, pass_index: int, first: int, frames: Frames, epoch: int) -> None:
        """Store a single shot now, or wait until the last burst is stored and begin with this one."""
        if len(frames) == 1:
            with self._stopwatch.step("storage"):
                self._writer.append(pass_index, first, frames, epoch)
            self.kept += 1
            return
        self.wait()
        self._stored = self._thread.submit(self._store, pass_index, first, frames, epoch)

    def sync(self) -> None:
        """Return when everything that was kept so far is on disk."""
        self.wait()
        self._writer.sync()

    def wait(self) -> None:
        """Return when the burst that is being stored, if there is one, is on disk."""
        stored, self._stored = self._stored, None
        if stored is not None:
            self.kept += stored.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            with noted_on(error):
                self.wait()
        finally:
            self._thread.shutdown()

    def _store(self, pass_index: int, first: int, frames: Frames, epoch: int) -> int:
        with self._stopwatch.beside(STORAGE_BESIDE):
            self._writer.append(pass_index, first, frames, epoch)
        return len(frames)
