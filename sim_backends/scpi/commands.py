"""Tables of SCPI commands: one line a command, and the search of a header in the table.

A header is written as in the manuals: capitals are the short form, `[:NODE]` and `[ROOT:]` may be left out, `#` stands
for a numeric suffix, the default one for a node that is left out: `[SOURce#:]VOLTage[:LEVel][:IMMediate][:AMPLitude]`.
A table is searched once for each spelling a client uses; after that it is one dictionary look-up.
Rules: SCPI-99, volume 1, chapter 6.
"""

import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import lru_cache
from itertools import product
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from sim_backends.scpi.arguments import Kind, Several, nr3, short_form
from sim_backends.scpi.family import Family
from sim_backends.scpi.messages import Argument, Chunk
from sim_backends.scpi.status import NotSimulated, ScpiError

Answer = str | bool | int | float | bytes | memoryview | list[Chunk] | None
"""What a method returns to be sent; None: nothing."""

_CACHED_SPELLINGS = 4096
_SENT_NODE = re.compile(r"([A-Z_*]+)(\d{0,9})")


def definite_block(data: memoryview) -> list[Chunk]:
    """A definite-length block, `#<digits><bytes>` and the bytes themselves, not copied; ten digits are written `#A`."""
    length = str(data.nbytes)
    return [f"#{len(length):X}{length}".encode(), data]


def chunks(answer: Answer) -> list[Chunk]:
    """An answer as the pieces to be sent, [] for none."""
    if answer is None:
        return []
    if isinstance(answer, list):
        return answer
    if isinstance(answer, (bytes, memoryview)):
        return [answer]
    if isinstance(answer, (bool, np.bool_)):
        return [b"1" if answer else b"0"]
    return [(nr3(answer) if isinstance(answer, float) else str(answer)).encode("latin-1", "replace")]


class Command(ABC):
    """One line of a table.

    Attributes:
        header: As declared, without `?`.
        acts: Whether there is a command form.
        answers: Whether there is a query form.
        effect: Whether it changes anything but the reply to its own query.
        waits: The instrument's question whether the command must still wait, if it ever does.
        endless: Whether it is answered again and again, until the client sends something.
        labelled: Whether the reply brings its own headers, if the instrument sends headers.
    """

    acts = answers = effect = True
    endless = labelled = False
    waits: Callable[[Any], Callable[[], bool]] | None = None

    def __init__(self, header: str) -> None:
        self.header = header.removesuffix("?")

    @abstractmethod
    def execute(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """Carry out the command form; only an Action of a line-oriented instrument replies."""

    @abstractmethod
    def answer(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """Carry out the query form."""


class Setting(Command):
    """A command that sets an attribute of the instrument and a query that reads it; `...?` makes it read-only.

    The attribute is a path: `sources#.markers#.high_v` takes the header's suffixes as indices. A property may refuse a
    value by raising ScpiError.
    """

    def __init__(self, header: str, attribute: str, kind: Kind, *, effect: bool = True) -> None:
        super().__init__(header)
        self.acts, self.effect = not header.endswith("?"), effect
        *self._owners, self.attribute = attribute.split(".")
        self.kind = kind
        self._kinds = (kind,)

    def execute(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """Set the attribute."""
        (value,) = bind(self._kinds, arguments)
        setattr(_owner(instrument, self._owners, suffixes), self.attribute, value)
        return []

    def answer(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """The attribute, formatted."""
        if arguments:
            raise ScpiError(-108)
        value = getattr(_owner(instrument, self._owners, suffixes), self.attribute)
        return chunks(self.kind.format(value, verbose=instrument.verbose))


def _owner(root: Any, path: Sequence[str], suffixes: Sequence[int]) -> Any:
    """What is at `path` below `root`; a name that ends in # is indexed with the next suffix."""
    owner, index = root, iter(suffixes)
    for name in path:
        owner = getattr(owner, name[:-1])[next(index)] if name[-1] == "#" else getattr(owner, name)
    return owner


class ItemSetting(Command):
    """A setting of one entry of a list, named by the first argument: `WLISt:WAVeform:SRATe "m",1e9`, `...SRATe? "m"`.

    Args:
        header: As declared.
        items: Attribute of the instrument: entries by name. An entry's `modified()` is called after each change.
        attribute: Path below the entry, `steps#.repeats` with the header's suffixes as indices.
        kind: The kind of the value.
        name: The kind of the name.
    """

    def __init__(self, header: str, items: str, attribute: str, kind: Kind, name: Kind) -> None:
        super().__init__(header)
        *self._owners, self._attribute = attribute.split(".")
        self._items = attrgetter(items)
        self._kind, self._name = kind, name

    def execute(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """Set the attribute of the entry."""
        name, value = bind((self._name, self._kind), arguments)
        item = self._items(instrument)[name]
        setattr(_owner(item, self._owners, suffixes), self._attribute, value)
        item.modified()
        return []

    def answer(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """The attribute of the entry."""
        (name,) = bind((self._name,), arguments)
        value = getattr(_owner(self._items(instrument)[name], self._owners, suffixes), self._attribute)
        return chunks(self._kind.format(value, verbose=instrument.verbose))


class _Call(Command):
    """A command carried out by a method of the instrument or of one of its parts (`waveforms.new`)."""

    def __init__(
        self,
        header: str,
        method: str,
        *kinds: Kind,
        waits: str = "",
        endless: bool = False,
        labelled: bool = False,
        effect: bool = True,
    ) -> None:
        super().__init__(header)
        self._method = attrgetter(method)
        self._kinds = kinds
        self.waits = attrgetter(waits) if waits else None
        self.endless, self.labelled, self.effect = endless, labelled, effect

    def execute(self, instrument: Any, suffixes: Sequence[int], arguments: Sequence[Argument]) -> list[Chunk]:
        """Call the method with the header's suffixes and the arguments; one that was left out is None."""
        return chunks(self._method(instrument)(*suffixes, *bind(self._kinds, arguments)))

    answer = execute


class Query(_Call):
    """A query answered by a method."""

    acts = False


class Action(_Call):
    """A command carried out by a method."""

    answers = False


def bind(kinds: Sequence[Kind], arguments: Sequence[Argument]) -> list[Any]:
    """The values of `arguments`, one for each kind; None for an optional one that was left out.

    Optional arguments are filled from the left while enough remain for the required ones.
    Raises ScpiError: -109 too few, -108 too many, and what the kinds refuse.
    """
    spare = len(arguments) - sum(kind.required for kind in kinds)
    if spare < 0:
        raise ScpiError(-109)
    if len(arguments) > len(kinds) and not any(isinstance(kind, Several) for kind in kinds):
        raise ScpiError(-108)
    values: list[Any] = []
    position = 0
    for kind in kinds:
        if isinstance(kind, Several):
            taken = arguments[position : position + spare + kind.required]
            values.append(tuple(kind.of.parse(argument) for argument in taken))
            position, spare = position + len(taken), 0
        elif kind.required or spare > 0:
            values.append(kind.parse(arguments[position]))
            position += 1
            spare -= not kind.required
        else:
            values.append(None)
    return values


class Found(NamedTuple):
    """What a header means: the command, its suffixes, and the path that a following bare header continues."""

    command: Command
    suffixes: tuple[int, ...]
    path: str


class _Node(NamedTuple):
    """A node of a header as declared; of a spelling, `sent` says whether it is there."""

    name: str
    suffixed: bool
    optional: bool
    sent: bool = True


class _Entry(NamedTuple):
    command: Command
    nodes: tuple[_Node, ...]


class CommandTable:
    """The commands of one model, searched by header.

    Args:
        commands: The table.
        suffixes: For each node that is declared with `#`, its highest suffix (the lowest is 1).
        default_suffix: What a missing suffix means; None: it may not be missing.
        family: Every header that instruments like this model have, if they are known.

    Attributes:
        find: The command that a header means behind a path, as a query or not; raises ScpiError -113 (undefined) or
            -114 (bad suffix), NotSimulated for a header that only the family has.
    """

    def __init__(
        self,
        commands: Iterable[Command],
        suffixes: Mapping[str, int] | None = None,
        default_suffix: int | None = 1,
        family: Family | None = None,
    ) -> None:
        self._limits = suffixes or {}
        self._default_suffix = default_suffix
        self._family = family
        self._entries: dict[tuple[str, bool], list[_Entry]] = {}
        self.find = lru_cache(_CACHED_SPELLINGS)(self._search)
        for command in commands:
            for key, nodes in _spellings(command.header):
                entry = _Entry(command, nodes)
                for query, meant in ((True, command.answers), (False, command.acts)):
                    if meant:
                        self._entries.setdefault((key, query), []).append(entry)

    def _search(self, path: str, header: str, query: bool) -> Found:
        if header.startswith("*"):
            whole, path_after = header, path
        else:
            whole = header[1:] if header.startswith(":") else path + header
            path_after = whole[: whole.rfind(":") + 1]
        nodes = [_SENT_NODE.fullmatch(node) for node in whole.upper().split(":")]
        parts = [(node[1], node[2]) for node in nodes if node]
        if len(parts) == len(nodes):
            for entry in self._entries.get((":".join(name for name, _ in parts), query), ()):
                suffixes = self._suffixes(entry, [digits for _, digits in parts], whole)
                if suffixes is not None:
                    return Found(entry.command, suffixes, path_after)
        if self._family and (known := self._family.known(whole, query=query)):
            raise NotSimulated(known)
        raise ScpiError(-113, _printable(header))

    def missing(self) -> Iterator[tuple[str, bool]]:
        """Headers of the family that the table lacks, and whether the query is meant."""
        for header, query in self._family or ():
            try:
                self._search("", header.replace("#", "1"), query)
            except NotSimulated:
                yield header, query

    def _suffixes(self, entry: _Entry, sent: list[str], header: str) -> tuple[int, ...] | None:
        """The suffixes for `entry`; None: this entry is not meant."""
        suffixes = []
        digits_sent = iter(sent)
        for node in entry.nodes:
            digits = next(digits_sent) if node.sent else ""
            if not node.suffixed:
                if digits:
                    return None
                continue
            suffix = int(digits) if digits else self._default_suffix
            if suffix is None:
                return None
            if not 1 <= suffix <= self._limits.get(node.name, 0):
                raise ScpiError(-114, _printable(header))
            suffixes.append(suffix)
        return tuple(suffixes)


def reply_header(command: Command, suffixes: Sequence[int], *, verbose: bool) -> str:
    """The header in front of a reply, `:CH1:SCALE` or `:CH1:SCA`; empty for common commands."""
    if command.header.startswith("*"):
        return ""
    index = iter(suffixes)
    words = []
    for node in _nodes(command.header):
        word = node.name.upper() if verbose else short_form(node.name)
        word += str(next(index)) if node.suffixed else ""
        words += [] if node.optional else [word]
    return ":" + ":".join(words)


def _printable(text: str) -> str:
    return "".join(character for character in text if character.isprintable())[:60]


def _nodes(header: str) -> list[_Node]:
    spaced = header.replace("[:", ":[").replace(":]", "]:").strip(":")
    bare = [(node.strip("[]"), node.startswith("[")) for node in spaced.split(":")]
    return [_Node(name.removesuffix("#"), name.endswith("#"), optional) for name, optional in bare]


def _spellings(header: str) -> Iterator[tuple[str, tuple[_Node, ...]]]:
    """Every way to write a header: its key without suffixes, and its nodes."""
    options = []
    for node in _nodes(header):
        forms = [(form, node) for form in dict.fromkeys((node.name.upper(), short_form(node.name)))]
        options.append([*forms, ("", node._replace(sent=False))] if node.optional else forms)
    for choice in product(*options):
        yield ":".join(form for form, node in choice if node.sent), tuple(node for _, node in choice)
