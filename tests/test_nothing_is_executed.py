"""No text or file is ever run as a program: nothing in the source could, but for a protocol that an operator names."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.checkout import ROOT

SOURCES = sorted(
    path
    for package in ("labctl", "instruments", "protocols", "sim_backends")
    for path in (ROOT / package).rglob("*.py")
)
CALLS = {"eval", "exec", "compile", "__import__"}
ATTRIBUTES = {
    ("os", "system"),
    ("os", "popen"),
    ("yaml", "load"),
    ("torch", "load"),
    ("joblib", "load"),
    ("code", "interact"),
}
METHODS = {"exec_module", "load_module", "run_path", "run_module"}
OWN_PROTOCOL = Path("protocols/own_file.py")
MODULES = {"pickle", "cPickle", "marshal", "shelve", "dill", "cloudpickle", "joblib", "commands", "pty"}


def executing(tree: ast.AST) -> Iterator[tuple[int, str]]:
    """Line and name of everything in a module that could run what it was given."""
    for node in ast.walk(tree):
        match node:
            case ast.Call(func=ast.Name(id=name)) if name in CALLS:
                yield node.lineno, name
            case ast.Attribute(value=ast.Name(id=module), attr=name) if (module, name) in ATTRIBUTES:
                yield node.lineno, f"{module}.{name}"
            case ast.Attribute(attr=name) if name in METHODS:
                yield node.lineno, name
            case ast.Import(names=names):
                yield from ((node.lineno, found.name) for found in names if found.name.partition(".")[0] in MODULES)
            case ast.ImportFrom(module=str(module)) if module.partition(".")[0] in MODULES:
                yield node.lineno, module
            case ast.keyword(arg="shell" | "allow_pickle", value=value) if not (
                isinstance(value, ast.Constant) and value.value is False
            ):
                yield value.lineno, str(node.arg)


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_no_module_runs_what_it_is_given(path: Path) -> None:
    found = [name for _, name in executing(ast.parse(path.read_text("utf-8")))]
    assert found == (["exec_module"] if path == ROOT / OWN_PROTOCOL else [])


def test_the_search_finds_what_it_looks_for() -> None:
    harmful = ("import pickle", "from marshal import loads", "eval('1')", "os.system('ls')", "run('ls', shell=True)")
    harmless = ("import json", "ast.literal_eval('1')", "network.eval()", "run('ls', shell=False)")
    found = executing(ast.parse("\n".join(harmful + harmless)))
    assert sorted(line for line, _ in found) == [1, 2, 3, 4, 5]
