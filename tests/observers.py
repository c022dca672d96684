"""An observer of a run that calls functions of the test."""

from collections.abc import Callable, Mapping
from typing import Any

from instruments.bench import Observer


class Follower(Observer):
    """Calls what it is given, as the observer is called; `progress` with the records that are done and all."""

    def __init__(
        self,
        progress: Callable[[int, int], object] = lambda _done, _total: None,
        uploading: Callable[[str, int, int], object] = lambda _what, _done, _total: None,
        warning: Callable[[str], object] = lambda _text: None,
        acquired: Callable[[], object] = lambda: None,
    ) -> None:
        self._progress, self._uploading, self._warning, self._acquired = progress, uploading, warning, acquired

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        self._progress(done, total)

    def uploading(self, what: str, done: int, total: int) -> None:
        self._uploading(what, done, total)

    def warning(self, text: str) -> None:
        self._warning(text)

    def acquired(self) -> None:
        self._acquired()
