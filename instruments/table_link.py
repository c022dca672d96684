"""The dialogue of a command table with its instrument: commands by name, answers by the groups of their expressions."""

import contextlib
import math
import re
from collections.abc import Iterator

from instruments.command_table import SWITCHED, UNKNOWN, Command, CommandTable
from instruments.errors import InstrumentError, NotConfigured, excerpt
from instruments.readback import confirm
from instruments.transcripts import Transcript
from instruments.visa import MAX_ERRORS_READ, VisaLink

LONGEST_ANSWER = 300
"""Characters of an answer that a table's expression is held against."""


class TableLink:
    """An instrument that is spoken to by the commands of a table."""

    def __init__(self, resource: str, table: CommandTable, *, name: str, transcript: Transcript) -> None:
        """The instrument called `name` at the VISA address `resource`."""
        self.table = table
        self._link = VisaLink(
            resource,
            name=name,
            timeout_s=table.transport.timeout_s,
            transcript=transcript,
            error_queue=self._read_errors,
            write_eol=table.transport.write_eol,
            read_eol=table.transport.read_eol,
        )

    def text(self, command: str) -> str:
        """The group `text` of the answer to a command."""
        return self._groups(command)["text"]

    def number(self, command: str) -> float:
        """The group `value` of the answer to a command, a number; ON is 1 and OFF 0."""
        text = self._groups(command)["value"]
        with contextlib.suppress(TypeError, ValueError):  # a group that is not part of every answer; or no number
            if math.isfinite(number := float(SWITCHED.get(str(text).upper(), text))):
                return number
        raise InstrumentError(f"{self._told(command, str(text))}, not a number: correct {self.table.source}")

    def send(self, command: str) -> None:
        """Send a command that has no answer and takes no number; whatever the error queue then holds."""
        self._link.write(self._command(command).write)

    @contextlib.contextmanager
    def checked(self) -> Iterator[None]:
        """`VisaLink.checked`."""
        with self._link.checked():
            yield

    def set(self, quantity: str, value: float, tolerance: float) -> float:
        """Send `set_<quantity>`, and return what `get_<quantity>` then answers.

        Raises:
            OutOfRange: outside the limits of the table; nothing was sent.
            InstrumentError: the answer lies further from it than `tolerance`, in the unit of the table.
        """
        command, limits = self._command(f"set_{quantity}"), self.table.range(quantity)
        limits.check(f"{self._link.name} {quantity}", value)
        with self.checked():
            self._link.write(command.write.format(value=value))
        answered = self.number(f"get_{quantity}")
        return confirm(f"{self._link.name}: {quantity}", value, answered, tolerance, unit=limits.unit)

    def errors(self) -> list[str]:
        """Empty the instrument's error queue and return what it held."""
        return self._link.errors()

    def close(self) -> None:
        """Close the link."""
        self._link.close()

    def _command(self, name: str) -> Command:
        command = self.table.commands.get(name)
        if command is None or command.write == UNKNOWN:
            raise NotConfigured(f"{self.table.source}: commands.{name} is not configured: enter it from the manual")
        return command

    def _groups(self, name: str) -> dict[str, str]:
        command = self._command(name)
        answer = self._link.query(command.write)
        match = re.fullmatch(command.reply or "(?P<text>.*)", answer) if len(answer) <= LONGEST_ANSWER else None
        if match is None:
            raise InstrumentError(
                f"{self._told(name, answer)}, expected {command.reply!r}: correct {self.table.source}"
            )
        return match.groupdict()

    def _told(self, name: str, answer: str) -> str:
        return f"{self._link.name}: {self._command(name).write!r} was answered {excerpt(answer)}"

    def _read_errors(self, _link: VisaLink) -> list[str]:
        errors: list[str] = []
        for _ in range(MAX_ERRORS_READ):
            reply = self._groups("error")
            if re.fullmatch(r"[-+]?0+", reply["code"] or ""):
                break
            errors.append(f"{reply['code']} {reply['text']}")
        return errors
