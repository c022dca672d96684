"""What people say of a run, on its page: read, and said there."""

from collections.abc import Callable
from pathlib import Path

from nicegui import ui

from labctl.dashboard.frame import Region
from labctl.dashboard.sketches import escape
from labctl.errors import RunError
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import Notes, read_notes, say_of


def show_notes(directory: Path, said: Callable[[], None]) -> Region:
    """Star, operator, tags and notes of a run; `said` is called when something was."""
    paths = RunPaths(directory)
    now = _read(paths)
    message = ui.label().classes("message")

    def say(**what: object) -> None:
        try:
            say_of(paths, **what)  # type: ignore[arg-type]
        except RunError as error:
            message.set_text(str(error))
            return
        message.set_text("")
        said()
        notes.refresh()

    def toggle() -> None:
        say(star=not _read(paths).star)
        star.set_text(_star(_read(paths)))

    def tagged() -> None:
        wanted, there = set(tags.value or ()), set(_read(paths).tags)
        if wanted != there:
            say(tags=sorted(wanted - there), untagged=sorted(there - wanted))

    def operated() -> None:
        if (operator.value or "").strip() not in ("", _read(paths).operator):
            say(operator=operator.value)

    def noted() -> None:
        say(text=text.value or "")
        if not message.text:
            text.set_value("")

    with ui.element("div").classes("notes-form"):
        star = ui.button(_star(now), on_click=toggle, color=None).classes("star").props("flat")
        operator = ui.input("Operator", value=now.operator).classes("operator").on("blur", operated)
        operator.on("keydown.enter", operated)
        tags = ui.input_chips("Tags", value=list(now.tags), on_change=tagged).classes("tags")
        text = ui.textarea("Note").props("autogrow rows=1").classes("note")
        ui.button("Add note", on_click=noted, color=None).classes("add-note")
    notes = Region("notes", lambda: _notes(_read(paths)))
    return notes


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
