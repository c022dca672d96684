"""Storing bursts while the bench goes on measuring."""

from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Self

from instruments.bench import Observer
from instruments.values import Frames
from labctl.engine.profile import STORAGE_BESIDE
from labctl.errors import noted_on
from labctl.runs.write.writer import RunWriter


class Storage:
    """Stores bursts in a thread of its own, each while the bench measures the next one.

    Attributes:
        kept: how many of their shots are on disk.
    """

    def __init__(self, writer: RunWriter, observer: Observer) -> None:
        """Store into `writer`; `observer` times how long that takes."""
        self.kept = 0
        self._writer = writer
        self._observer = observer
        self._thread = ThreadPoolExecutor(1, thread_name_prefix="storage")
        self._stored: Future[int] | None = None

    def keep(self, pass_index: int, first: int, frames: Frames, epoch: int, *, sure: bool) -> None:
        """Wait until the last burst is stored and begin with this one, suspect unless somebody is `sure` of it."""
        self.wait()
        self._stored = self._thread.submit(self._store, pass_index, first, frames, epoch, sure)

    def wait(self) -> None:
        """Return when the burst that is being stored, if there is one, is on disk.

        Raises:
            RunError: the disk is full or refuses.
        """
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

    def _store(self, pass_index: int, first: int, frames: Frames, epoch: int, sure: bool) -> int:
        with self._observer.step(STORAGE_BESIDE):
            self._writer.append(pass_index, first, frames, epoch, sure=lambda: sure)
        return len(frames.codes)
