"""The headers of a family of instruments as its maker lists them: what a twin lacks, told apart from nonsense.

A list is a text: one node of the tree a line, one space more for each level, behind a node `!` where a command ends
there and `?` where a query does; `#` stands for a numeric suffix, `%` begins a comment.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

from sim_backends.scpi.arguments import short_form


@dataclass
class _Node:
    """What can follow a node, by every way to write it; `forms` holds the marks of what ends here."""

    path: str = ""
    forms: str = ""
    children: "dict[str, _Node]" = field(default_factory=dict)


class Family:
    """The tree of a family's headers.

    Args:
        text: The list.
        suffix_required: Whether a numeric suffix may not be left out.
    """

    def __init__(self, text: str, *, suffix_required: bool) -> None:
        self._suffix_required = suffix_required
        self._headers: dict[str, str] = {}
        path = [_Node()]
        for line in text.splitlines():
            if not line or line.startswith("%"):
                continue
            name, _, forms = line.strip().partition(" ")
            path = path[: len(line) - len(line.lstrip()) + 1]
            node = _Node(f"{path[-1].path}:{name}".lstrip(":"), forms)
            for form in (name.upper(), short_form(name)):
                path[-1].children.setdefault(form, node)
            if forms:
                self._headers[node.path] = forms
            path.append(node)
        self._root = path[0]

    def __iter__(self) -> Iterator[tuple[str, bool]]:
        """Every header, as the list writes it, and whether its query is meant; in the order of the list."""
        for header, forms in self._headers.items():
            for mark in forms:
                yield header, mark == "?"

    def known(self, header: str, *, query: bool) -> str | None:
        """How the list writes a header that was sent; None: the family has no such command or query."""
        nodes = [self._root]
        for sent in header.upper().split(":"):
            nodes = [child for node in nodes for child in self._children(node, sent)]
        return next((node.path for node in nodes if ("?" if query else "!") in node.forms), None)

    def _children(self, node: _Node, sent: str) -> Iterator[_Node]:
        """What is meant behind `node`: a name that holds digits itself, or a name and its suffix."""
        bare = sent.rstrip("0123456789")
        lengths = range(len(bare), len(sent) + (not self._suffix_required))
        names = [sent, *(f"{sent[:length]}#" for length in lengths)]
        yield from (node.children[name] for name in names if name in node.children)
