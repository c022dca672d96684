"""What people say of runs at their start, and the observer that writes it beside each of them."""

from pathlib import Path

from pydantic import BaseModel, ConfigDict, field_validator

from instruments.bench import Observer
from labctl.runs.format.layout import RunPaths
from labctl.runs.notes import in_a_line, say_of


class Said(BaseModel):
    """A note, tags, a star and the operator, as a line of notes.jsonl has them; nothing by default.

    Raises:
        RunError: it is too long, or a tag or name is empty.
    """

    model_config = ConfigDict(frozen=True)

    note: str = ""
    tags: tuple[str, ...] = ()
    star: bool = False
    operator: str | None = None

    @field_validator("note")
    @classmethod
    def _written(cls, note: str) -> str:
        return str(in_a_line(note).get("note", ""))

    @field_validator("tags")
    @classmethod
    def _words(cls, tags: tuple[str, ...]) -> tuple[str, ...]:
        return tuple(in_a_line(tags=tags).get("tags", ()))

    @field_validator("operator")
    @classmethod
    def _named(cls, operator: str | None) -> str | None:
        name: str | None = in_a_line(operator=operator).get("operator")
        return name


class Saying(Observer):
    """Says it of every run it follows, as soon as the run is there; nothing more of one that has notes."""

    def __init__(self, said: Said) -> None:
        """Nothing is written yet."""
        self._said = said

    def stored_in(self, directory: Path) -> None:
        """Write it beside what is measured."""
        said, paths = self._said, RunPaths(directory)
        if said != Said() and not paths.notes.exists():
            say_of(paths, said.note, tags=said.tags, star=said.star or None, operator=said.operator)
