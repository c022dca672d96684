"""Questions to a person at a terminal; an answer that cannot be used is asked for again, at once."""

from collections.abc import Callable

import typer
from pydantic import ValidationError

from instruments.toml_files import describe
from labctl.printable import printable


def ask(question: str, default: str, check: Callable[[str], object]) -> str:
    """The answer to `question`, or `default`, which may be empty, for Enter.

    check: raises `ValueError` where an answer cannot be used.
    """

    def checked(answer: str) -> str:
        try:
            check(answer)
        except ValidationError as error:
            raise typer.BadParameter(printable(describe(error))) from None
        except ValueError as error:
            raise typer.BadParameter(printable(str(error))) from None
        return answer

    return str(
        typer.prompt(printable(question), default=default, show_default=bool(default), value_proc=checked, err=True)
    )


def confirm(question: str) -> bool:
    """Whether the answer is yes; Enter is no."""
    return typer.confirm(printable(question), default=False, err=True)
