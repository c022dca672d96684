"""The directives of the page on architecture: floors and their drawing from the contracts, the way of a shot traced."""

import ast
import shutil
import tomllib
from importlib.util import find_spec
from itertools import pairwise, permutations
from pathlib import Path

import grimp
from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.ext.graphviz import graphviz
from sphinx.util.docutils import SphinxDirective

from benchmarks.way_of_a_shot import CLIENT, SIMULATOR, trace

ROOT = Path(__file__).parents[2]
MISSING = "*The drawing is missing: Graphviz, which makes it, is not installed where this page was built.*"


class Floors(SphinxDirective):
    """A table of the layers contract of that name: the floor, its packages, and what each is for."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """The table."""
        lines = ["| floor | package | what it is for |", "|---|---|---|"]
        floors = _floors(self.arguments[0])
        for number, packages in zip(range(len(floors), 0, -1), floors, strict=True):
            lines += [f"| {number} | `{package}` | {_purpose(package)} |" for package in packages]
        return self.parse_text_to_nodes(StringList(lines, "pyproject.toml"))


class FloorDrawing(SphinxDirective):
    """The packages of a layers contract, floor above floor, with an arrow wherever one really imports another."""

    required_arguments = 1
    final_argument_whitespace = True

    def run(self) -> list[nodes.Node]:
        """The drawing, or a line that says why there is none."""
        if shutil.which("dot") is None:
            return self.parse_text_to_nodes(StringList([MISSING], "pyproject.toml"))
        floors = _floors(self.arguments[0])
        packages = [package for floor in floors for package in floor]
        imports = grimp.build_graph("labctl", "protocols", "instruments", "sim_backends", cache_dir=None)
        lines = ["digraph floors {", 'node [shape=box, fontname="sans-serif", fontsize=11]', "edge [color=gray50]"]
        lines += ["{ rank=same; " + "; ".join(f'"{package}"' for package in floor) + " }" for floor in floors]
        lines += [f'"{one[0]}" -> "{other[0]}" [style=invis]' for one, other in pairwise(floors)]
        lines += [
            f'"{importer}" -> "{imported}"'
            for importer, imported in permutations(packages, 2)
            if imports.direct_import_exists(importer=importer, imported=imported, as_packages=True)
        ]
        drawing = graphviz()
        drawing["code"] = "\n".join((*lines, "}"))
        drawing["options"] = {"docname": self.env.docname}
        drawing["alt"] = f"{self.arguments[0]}, drawn: what each package imports"
        return [drawing]


class WayOfAShot(SphinxDirective):
    """The files that take part in one software-timed shot, in the order in which they come, traced while building."""

    def run(self) -> list[nodes.Node]:
        """A list of the client's files and one of the simulated bench's."""
        way = trace()
        lines: list[str] = []
        for packages, heading in ((CLIENT, "On this side of the wire"), (SIMULATOR, "On the other, in the simulation")):
            files = way.files(packages)
            lines += [f"{heading}, {len(files)} files with {way.moves(packages)} moves between them:", ""]
            lines += [f"1. `{name}`: {_first_line(ROOT / name)}" for name in files] + [""]
        return self.parse_text_to_nodes(StringList(lines, "benchmarks/way_of_a_shot.py"))


def _floors(contract: str) -> list[list[str]]:
    """The layers of a contract of import-linter, the highest first, each a list of packages."""
    with (ROOT / "pyproject.toml").open("rb") as file:
        contracts = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    (found,) = [one for one in contracts if one["name"] == contract]
    return [[package.strip() for package in layer.split("|")] for layer in found["layers"]]


def _purpose(package: str) -> str:
    spec = find_spec(package)
    return _first_line(Path(spec.origin)) if spec is not None and spec.origin is not None else ""


def _first_line(file: Path) -> str:
    """First line of a module's docstring."""
    return (ast.get_docstring(ast.parse(file.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.setup_extension("sphinx.ext.graphviz")
    app.add_directive("floors", Floors)
    app.add_directive("floor-drawing", FloorDrawing)
    app.add_directive("way-of-a-shot", WayOfAShot)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
