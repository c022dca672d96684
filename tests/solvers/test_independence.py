"""What is held against the simulated bench must not be made of it."""

import ast
from pathlib import Path

import pytest

SOLVERS = sorted(path for path in Path(__file__).parent.glob("*.py") if not path.name.startswith("test_"))
SHARED = {"sim_backends.parameters"}


@pytest.mark.parametrize("path", SOLVERS, ids=lambda path: path.stem)
def test_a_solver_shares_parameters_with_the_bench_and_nothing_else(path: Path) -> None:
    imported = {
        node.module or "" for node in ast.walk(ast.parse(path.read_text("utf-8"))) if isinstance(node, ast.ImportFrom)
    }
    projects = {module for module in imported if module.split(".")[0] in ("sim_backends", "labctl", "instruments")}
    assert projects <= SHARED
