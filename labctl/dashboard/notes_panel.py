"""What people say of a run, on its page: read, and said there."""

from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from labctl.dashboard.frame import Region
from labctl.dashboard.sketches import escape
from labctl.errors import RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import Notes, read_notes, say_of


class NotesPanel:
    """Star, operator, tags and notes of a run, as they are said here or elsewhere; `said` is called when something was.

    What is said is what has been done on this page: whatever others have said meanwhile stays.
    """

    def __init__(self, directory: Path, said: Callable[[], None]) -> None:
        """Of the run in `directory`."""
        self._paths = RunPaths(directory)
        self._said = said
        self._shown = now = _read(self._paths)
        self._message = ui.label().classes("message")
        with ui.element("div").classes("notes-form"):
            self._star = ui.button(_star(now), on_click=self._toggle, color=None).classes("star").props("flat")
            self._operator = ui.input("Operator", value=now.operator).classes("operator").on("blur", self._operated)
            self._operator.on("keydown.enter", self._operated)
            self._tags = ui.input_chips("Tags", value=list(now.tags)).classes("tags")
            self._tags.on("add", lambda event: self._say(tags=[event.args["value"]]))
            self._tags.on("remove", lambda event: self._say(untagged=[event.args["value"]]))
            self._text = ui.textarea("Note").props("autogrow rows=1").classes("note")
            ui.button("Add note", on_click=self._note, color=None).classes("add-note")
        self._notes = Region("notes", lambda: _notes(self._shown))

    def refresh(self) -> None:
        """Show what is said now; an operator who is being typed stays."""
        before, self._shown = self._shown, _read(self._paths)
        self._star.set_text(_star(self._shown))
        if (self._operator.value or "").strip() == before.operator:
            self._operator.set_value(self._shown.operator)
        if self._tags.value != list(self._shown.tags):
            self._tags.set_value(list(self._shown.tags))
        self._notes.refresh()

    def _toggle(self) -> None:
        self._say(star=not self._shown.star)

    def _operated(self) -> None:
        if (self._operator.value or "").strip() not in ("", self._shown.operator):
            self._say(operator=self._operator.value)

    def _note(self) -> None:
        self._say(text=self._text.value or "")
        if not self._message.text:
            self._text.set_value("")

    def _say(self, **what: object) -> None:
        try:
            say_of(self._paths, **what)  # type: ignore[arg-type]
        except RunError as error:
            self._message.set_text(str(error))
            return
        self._message.set_text("")
        self._said()
        self.refresh()


def notes_of(directory: Path) -> str:
    """All that is said of a run, as HTML; empty where nothing is."""
    found = _read(RunPaths(directory))
    said = (_star(found) if found.star else "", found.operator and f"by {found.operator}", *found.tags)
    about = " · ".join(filter(None, said))
    return (f"<p>{escape(about)}</p>" if about else "") + _notes(found)


def _star(found: Notes) -> str:
    return "★ starred" if found.star else "☆ star"


def _notes(found: Notes) -> str:
    """The notes, the last first."""
    lines = [f'<p class="problem">{escape(problem)}</p>' for problem in found.problems]
    lines += [
        f"<li><time>{escape(one.time[:16].replace('T', ' '))}</time> <b>{escape(one.by)}</b> {escape(one.text)}</li>"
        for one in reversed(found.notes)
    ]
    return f"<ul>{''.join(lines)}</ul>" if lines else ""


def _read(paths: RunPaths) -> Notes:
    try:
        return read_notes(paths)
    except RunError as error:
        return Notes(problems=(str(error),))
