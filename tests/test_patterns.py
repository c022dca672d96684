"""Patterns mean the same in every Python that labctl runs on.

Python 3.11.0 to 3.11.4, which Debian 12 has, match less than they should where a possessive quantifier or an atomic
group holds anything that could be tried in another way (CPython issue 106052).
"""

import ast
import re
from collections.abc import Iterator

import pytest

from tests.test_nothing_is_executed import SOURCES

MISUNDERSTOOD = ("POSSESSIVE_REPEAT", "ATOMIC_GROUP")


def patterns(tree: ast.AST) -> Iterator[str | bytes]:
    """What is given to the functions of `re`, as far as it is written out."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Attribute(value=ast.Name(id="re")), args=[ast.Constant(value=str() | bytes()), *_]):
                yield node.args[0].value  # type: ignore[attr-defined]


def is_misunderstood(pattern: str | bytes) -> bool:
    text = pattern if isinstance(pattern, str) else pattern.decode("latin-1")
    return any(name in repr(re._parser.parse(text).data) for name in MISUNDERSTOOD)  # type: ignore[attr-defined]


def test_no_pattern_is_misunderstood() -> None:
    found = [
        f"{path.name}: {pattern!r}"
        for path in SOURCES
        for pattern in patterns(ast.parse(path.read_text("utf-8")))
        if is_misunderstood(pattern)
    ]
    assert found == []


@pytest.mark.parametrize(
    ("pattern", "misunderstood"), [("(?:a|b)*+", True), ("(?>a+)", True), (rb"\++(?:a|b)*", False)]
)
def test_the_search_finds_what_it_looks_for(pattern: str | bytes, misunderstood: bool) -> None:
    source = f"re.compile({pattern!r})"
    assert [is_misunderstood(one) for one in patterns(ast.parse(source))] == [misunderstood]
