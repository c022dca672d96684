"""The words by which runs are found: `protocol = image-readout and images >= 300 and tag = good`.

A comparison is a key, one of = != < <= > >= ~ (contains) and a value, which may have a unit: `window >= 1 ns`. They are
joined by `and`, `or`, `not` and brackets. When a run started, is compared with a day or second: `started = 2026-11-21`.
Words without a comparison are looked for in all that is known of a run, and each of them must begin one of its words:
`crack incomplete`.
"""

import re
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta
from difflib import get_close_matches

from instruments.units import any_quantity
from labctl.errors import UsageError

LONGEST, MOST_NESTED = 500, 30
"""Characters of a search; of its brackets and `not`, which SQLite takes in one another only so deep."""
OPERATORS = ("!=", "<=", ">=", "=", "<", ">", "~")
_TOKEN = re.compile(r"""\s*(?:(?P<text>"[^"]*"|'[^']*')|(?P<sign>!=|<=|>=|[=<>~()])|(?P<word>[^\s()=<>!~"']+|!))""")
_HAS = "EXISTS (SELECT 1 FROM fact WHERE fact.run = run.name AND fact.key = ? AND {})"
Condition = tuple[str, list[str | float]]
"""SQL over the tables `run` and `fact`, and its parameters."""


@dataclass(frozen=True)
class Token:
    """A sign, a word, or text in quotation marks."""

    text: str
    quoted: bool = False

    def is_word(self, *words: str) -> bool:
        """Whether it is one of the words, capitals or not, and not quoted."""
        return not self.quoted and self.text.lower() in words


def condition(words: str, keys: frozenset[str], holds_text: Callable[[str], bool]) -> Condition:
    """What `words` ask for, of runs that have some of `keys`; `holds_text`: whether one of these ever is no number.

    Raises:
        UsageError: they cannot be understood, or compare what no run has.
    """
    if len(words) > LONGEST:
        raise UsageError(f"a search of {len(words)} characters: write {LONGEST} at most")
    tokens = _tokens(words)
    if sum(token.is_word("not", "(") for token in tokens) > MOST_NESTED:
        raise UsageError(f"a search with more than {MOST_NESTED} brackets and not: write fewer")
    search = _Search(tokens, keys, holds_text)
    return search.whole() if search.tokens else ("1", [])


def _tokens(words: str) -> list[Token]:
    found, place = [], 0
    while place < len(words.rstrip()):
        if (match := _TOKEN.match(words, place)) is None:
            raise UsageError(f"{words[place:].strip()}: a quotation mark is missing")
        place = match.end()
        quoted = match["text"] is not None
        found.append(Token(match["text"][1:-1] if quoted else match[0].strip(), quoted))
    return found


def unknown(key: str, keys: frozenset[str]) -> UsageError:
    """The one line for a key that no run has."""
    close = get_close_matches(key, keys, 1)
    hint = f"did you mean {close[0]}?" if close else "see `labctl runs --keys`"
    return UsageError(f"{key}: no run here has that: {hint}")


def when(said: str, text: str) -> tuple[str, str]:
    """The first moment of a day or a second, and the first one after it, as runs have it: UTC, which is meant without a
    zone. `said`: what somebody has written, for the message.

    Raises:
        UsageError: `text` is not a date.
    """
    try:
        found = datetime.fromisoformat(text)
        begin = (found if found.tzinfo else found.replace(tzinfo=UTC)).astimezone(UTC).replace(microsecond=0)
        end = begin + (timedelta(days=1) if _is_day(text) else timedelta(seconds=1))
    except (ValueError, OverflowError):
        raise UsageError(f"{said}: is not a date: write it like 2026-11-21 or 2026-11-21T09:15") from None
    return begin.isoformat(), end.isoformat()


def words_in(text: str) -> list[str]:
    """The words of a text in small letters; a name with hyphens has several."""
    return [word for word in re.split(r"[^\w=.:]+", text.lower()) if word]


class _Search:
    """Takes tokens from left to right: `or` joins what `and` joins."""

    def __init__(self, tokens: list[Token], keys: frozenset[str], holds_text: Callable[[str], bool]) -> None:
        self.tokens = tokens
        self._keys = keys
        self._holds_text = holds_text

    def whole(self) -> Condition:
        found = self._any()
        if self.tokens:
            raise UsageError(f"{self.tokens[0].text}: is not understood here: join by and, or, not")
        return found

    def _any(self) -> Condition:
        found = [self._every()]
        while self._next_is("or"):
            found.append(self._every())
        return _joined(found, " OR ")

    def _every(self) -> Condition:
        found = [self._one()]
        while self.tokens and not self.tokens[0].is_word("or", ")"):
            self._next_is("and")
            found.append(self._one())
        return _joined(found, " AND ")

    def _one(self) -> Condition:
        if self._next_is("not"):
            sql, values = self._one()
            return f"NOT {sql}", values
        if self._next_is("("):
            found = self._any()
            if not self._next_is(")"):
                raise UsageError("a bracket is not closed: write )")
            return found
        if not self.tokens or self.tokens[0].is_word(*OPERATORS, "and", "or", ")"):
            what = self.tokens[0].text if self.tokens else "the end"
            raise UsageError(f"{what}: comes where a word or a comparison is missing, such as images >= 300")
        word = self.tokens.pop(0)
        if self.tokens and self.tokens[0].is_word(*OPERATORS):
            return self._compared(word.text.lower(), self.tokens.pop(0).text)
        return "run.words LIKE ? ESCAPE '\\'", [f"% {_literally(' '.join(words_in(word.text)))}%"]

    def _compared(self, key: str, operator: str) -> Condition:
        if key not in self._keys:
            raise unknown(key, self._keys)
        value: list[str] = []
        while self.tokens and not self.tokens[0].is_word("and", "or", ")") and not self._begins_another():
            value.append(self.tokens.pop(0).text)
        if not value:
            raise UsageError(f"{key} {operator}: a value is missing")
        text = " ".join(value)
        if operator != "~" and _number(text) is None and not self._holds_text(key):
            raise UsageError(
                f"{key} {operator} {text}: {key} is a number: write one, with its unit, such as 0.8 or 1 ns"
            )
        return _comparison(key, operator, text)

    def _begins_another(self) -> bool:
        return len(self.tokens) > 1 and self.tokens[1].is_word(*OPERATORS)

    def _next_is(self, word: str) -> bool:
        found = bool(self.tokens) and self.tokens[0].is_word(word)
        if found:
            self.tokens.pop(0)
        return found


def _comparison(key: str, operator: str, value: str) -> Condition:
    if operator == "~":
        return _HAS.format("fact.text LIKE ? ESCAPE '\\'"), [key, f"%{_literally(value)}%"]
    if operator == "!=":
        sql, values = _comparison(key, "=", value)
        return f"NOT {sql}", values
    if key == "started":
        begin, end = when(f"{key} {operator} {value}", value)
        if operator == "=":
            return _HAS.format("fact.text >= ? AND fact.text < ?"), [key, begin, end]
        sign, border = {"<": ("<", begin), ">=": (">=", begin), "<=": ("<", end), ">": (">=", end)}[operator]
        return _HAS.format(f"fact.text {sign} ?"), [key, border]
    if (number := _number(value)) is None:
        return _HAS.format(f"fact.text {operator} ?"), [key, value]
    if operator == "=":  # a tag or a name may read like a number
        return _HAS.format("(fact.number = ? OR fact.text = ?)"), [key, number, value]
    return _HAS.format(f"fact.number {operator} ?"), [key, number]


def _is_day(text: str) -> bool:
    with suppress(ValueError):
        return bool(date.fromisoformat(text))
    return False


def _number(value: str) -> float | None:
    """A number, or a quantity in SI units (a wavelength in nm); None for anything else."""
    with suppress(ValueError):
        return float(value)
    known = any_quantity(value)
    return None if known is None else known[0]


def _literally(text: str) -> str:
    return re.sub(r"([%_\\])", r"\\\1", text)


def _joined(found: list[Condition], word: str) -> Condition:
    if len(found) == 1:
        return found[0]
    return f"({word.join(sql for sql, _ in found)})", [value for _, values in found for value in values]
