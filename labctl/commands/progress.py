"""The line of progress on standard error: how far something is, how fast, and how long still."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from instruments.bench import Observer
from instruments.safe_state import UnsafeBench
from labctl.commands.beside import Beside
from labctl.commands.output import errors
from labctl.printable import printable


class ProgressLine(Observer):
    """A bar with rate and remaining time, and a line for each warning.

    Whoever measures sets numbers and leaves lines; only `draw` touches the bar, and another thread calls it.
    """

    def __init__(self, bar: Progress, title: str, tell: Callable[[str, str], None]) -> None:
        """Show `title` on `bar`, and no numbers yet; `tell` takes lines above it, with their styles."""
        self._bar = bar
        self._tell = tell
        self._title = self._described = title
        self._now: tuple[str, int, int | None] = title, 0, None
        self._task = bar.add_task(title, total=None)

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """So much of what the title says is done."""
        self._now = self._title, done, total

    def uploading(self, what: str, done: int, total: int) -> None:
        """So much of `what` is uploaded; the line says so until something else is done."""
        self._now = f"{self._title}: uploading {printable(what)}", done, total

    def warning(self, text: str) -> None:
        """One line above the bar."""
        self._tell(f"labctl: {text}", "")

    def safe_state(self, error: UnsafeBench | None) -> None:
        """A laser that did not go dark, in red, each time that it was tried; what a run ends in repeats it anywhere."""
        if errors.is_terminal and error is not None and "laser" in error.disobeyed:
            self._tell(f"labctl: {error}", "bold red")

    def draw(self) -> None:
        """Draw the line as it is now."""
        description, done, total = self._now
        if self._described != description:  # the rate of one thing says nothing about that of another
            self._described = description
            self._bar.reset(self._task, description=description, completed=done, total=total)
        else:
            self._bar.update(self._task, completed=done, total=total, refresh=True)


class RateColumn(ProgressColumn):
    """How many a second, worked out when it is drawn."""

    def render(self, task: Task) -> Text:
        """Of the last half minute; empty before there is one."""
        return Text(f"{task.speed:.0f}/s" if task.speed else "")


COLUMNS = (
    TextColumn("{task.description}", markup=False),
    BarColumn(),
    MofNCompleteColumn(),
    RateColumn(),
    TimeRemainingColumn(),
)


@contextmanager
def progress_bar(title: str) -> Iterator[ProgressLine]:
    """One line of progress on standard error; only where somebody can see it."""
    bar = Progress(
        *COLUMNS,
        console=errors,
        auto_refresh=False,
        transient=True,
        redirect_stdout=False,
        redirect_stderr=False,
        disable=not errors.is_terminal,
    )
    beside = Beside(errors)
    line = ProgressLine(bar, title, beside.tell)
    with beside.writing(bar, line.draw):
        yield line
