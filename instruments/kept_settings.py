"""The settings of a SCPI instrument: sent, read back, and later compared with what they were then."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from instruments.errors import InstrumentError, excerpt
from instruments.readback import confirm
from instruments.values import Change
from instruments.visa import VisaLink, number_in

SWITCH = {"ON": "1", "OFF": "0"}


@dataclass(frozen=True)
class Setting:
    """A setting as it is sent, and how far what is read back may lie from it.

    Attributes:
        command: its header; with a question mark it is asked for.
        value: what is sent, a number or a word in mixed case: its capitals are the short form (SCPI-99, 6.2.1).
        tolerance: of a number, in `unit`; instruments round to their own steps.
        name: for messages, the header where there is none.
        surplus: how much more than was asked for it may give of its own accord, in `unit`.
        target: which of several it is for, as in `TRIGger:LEVel 1.4,ATRigger`.
    """

    command: str
    value: str
    tolerance: float = 0.0
    unit: str = ""
    name: str = ""
    surplus: float = 0.0
    target: str = ""

    @property
    def message(self) -> str:
        """What sets it."""
        return f"{self.command} {self.value},{self.target}" if self.target else f"{self.command} {self.value}"

    @property
    def question(self) -> str:
        """What asks for it."""
        return f"{self.command}? {self.target}".rstrip()

    def check(self, instrument: str, answer: str) -> None:
        """Compare the answer to the question with the value.

        Raises:
            InstrumentError: it is another one.
        """
        name = f"{instrument}: {self.name or self.command}"
        asked = number_in(self.value)
        if asked is not None and (got := number_in(answer)) is not None:
            if not asked <= got <= asked + self.surplus:
                confirm(name, asked, got, self.tolerance, unit=self.unit)
        elif answer.upper() not in self._words():
            raise InstrumentError(
                f"{name}: asked for {self.value}, got {excerpt(answer)}: choose a value the instrument supports"
            )

    def _words(self) -> tuple[str, ...]:
        long = self.value.upper()
        return long, "".join(letter for letter in self.value if not letter.islower()), SWITCH.get(long, long)


class KeptSettings:
    """What an instrument answered once it was set: asked again, all in one question, it must answer the same."""

    def __init__(self, link: VisaLink) -> None:
        """Of the instrument behind `link`; nothing is set yet."""
        self._link = link
        self._answers: dict[str, str] = {}

    def set(self, settings: Sequence[Setting]) -> tuple[str, ...]:
        """Send settings, ask what became of them, and keep the answers.

        Raises:
            InstrumentError: the instrument's own error, or a setting that did not take.
        """
        try:
            with self._link.checked():
                for setting in settings:
                    self._link.write(setting.message)
        except InstrumentError:  # what was taken before it is nobody else's change
            self.forget([setting.question for setting in settings])
            raise
        return self.confirm(settings)

    def confirm(self, settings: Sequence[Setting]) -> tuple[str, ...]:
        """Ask what became of settings that were sent, and keep the answers.

        Raises:
            InstrumentError: one of them did not take.
        """
        answers = self.keep([setting.question for setting in settings])
        for setting, answer in zip(settings, answers, strict=True):
            setting.check(self._link.name, answer)
        return answers

    def keep(self, questions: Sequence[str]) -> tuple[str, ...]:
        """Ask for what is as it is, and keep the answers.

        Raises:
            InstrumentError: another number of answers came.
        """
        answers = self._ask(questions)
        self._answers |= dict(zip(questions, answers, strict=True))
        return answers

    def forget(self, questions: Iterable[str] | None = None) -> None:
        """Compare nothing any more, or not what `questions` ask for."""
        for question in tuple(self._answers) if questions is None else questions:
            self._answers.pop(question, None)

    def changes(self) -> tuple[Change, ...]:
        """What is answered otherwise than when it was kept.

        Raises:
            LinkError: no answer.
        """
        questions, then = tuple(self._answers), ";".join(self._answers.values())
        if not questions or (now := self._link.query(";:".join(questions))) == then:
            return ()
        answers = now.split(";")
        if len(answers) != len(questions):
            return (Change("its answers", excerpt(then), excerpt(now)),)
        pairs = zip(self._answers.items(), answers, strict=True)
        return tuple(Change(question.replace("?", ""), old, new) for (question, old), new in pairs if new != old)

    def _ask(self, questions: Sequence[str]) -> tuple[str, ...]:
        reply = self._link.query(";:".join(questions))
        answers = tuple(reply.split(";"))
        if len(answers) != len(questions):
            raise InstrumentError(
                f"{self._link.name} at {self._link.resource}: {len(questions)} settings were asked for, and "
                f"{excerpt(reply)} came: check that the driver fits the instrument"
            )
        return answers
