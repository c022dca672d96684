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
from labctl.commands.output import errors, warn
from labctl.printable import printable


class ProgressLine(Observer):
    """A bar with rate and remaining time, and a line for each warning."""

    def __init__(self, bar: Progress, title: str) -> None:
        """Show `title` on `bar`, and no numbers yet."""
        self._bar = bar
        self._title = self._described = title
        self._task = bar.add_task(title, total=None)

    def progress(self, done: int, total: int, last: Callable[[], Mapping[str, Any]] = dict) -> None:
        """So much of what the title says is done."""
        self._show(self._title, done, total)

    def uploading(self, what: str, done: int, total: int) -> None:
        """So much of `what` is uploaded; the line says so until something else is done."""
        self._show(f"{self._title}: uploading {printable(what)}", done, total)

    def warning(self, text: str) -> None:
        """One line above the bar."""
        warn(text)

    def safe_state(self, error: UnsafeBench | None) -> None:
        """A laser that did not go dark, in red, each time that it was tried; what a run ends in repeats it anywhere."""
        if errors.is_terminal and error is not None and "laser" in error.disobeyed:
            errors.print(printable(f"labctl: {error}"), markup=False, style="bold red")

    def refresh(self) -> None:
        """Draw the line now instead of at its next turn."""
        self._bar.refresh()

    def _show(self, description: str, done: int, total: int) -> None:
        if self._bar.disable:  # nobody sees it, and records come by the thousand
            return
        if self._described != description:  # the rate of one thing says nothing about that of another
            self._described = description
            self._bar.reset(self._task, description=description, completed=done, total=total)
        else:
            self._bar.update(self._task, completed=done, total=total)


class RateColumn(ProgressColumn):
    """How many a second, worked out when it is drawn."""

    def render(self, task: Task) -> Text:
        """Of the last half minute; empty before there is one."""
        return Text(f"{task.speed:.0f}/s" if task.speed else "")


@contextmanager
def progress_bar(title: str) -> Iterator[ProgressLine]:
    """One line of progress on standard error; only where somebody can see it."""
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        RateColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=errors, transient=True, disable=not errors.is_terminal) as bar:
        yield ProgressLine(bar, title)
