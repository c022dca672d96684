"""The directive `column-table`: the columns of `/shots`, or the arrays of data.h5, as the code declares them."""

from typing import ClassVar

from docutils import nodes
from docutils.statemachine import StringList
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from labctl.runs.format.columns import ARRAYS, FIRST_VERSION, SHOTS, Column

TYPES = {"<i8": "int64", "<i4": "int32", "<f8": "float64", "<f4": "float32", "?": "bool", "": "int8 or int16"}


class ColumnTable(SphinxDirective):
    """One row a column; the argument is `shots` or `arrays`."""

    required_arguments: ClassVar[int] = 1

    def run(self) -> list[nodes.Node]:
        """The table."""
        if self.arguments[0] == "shots":
            lines = ["| column | type | unit | what | known |", "|---|---|---|---|---|", *map(_shot_row, SHOTS)]
        else:
            lines = ["| name | shape | type | unit | what |", "|---|---|---|---|---|", *map(_array_row, ARRAYS)]
        return self.parse_text_to_nodes(StringList(lines, "labctl/runs/format/columns.py"))


def _shot_row(column: Column) -> str:
    known = "from the plan" if column.planned else "when it is measured"
    since = "" if column.since == FIRST_VERSION else f", since {column.since}"
    return f"| `{column.name}` | {_type(column)} | {column.unit} | {column.meaning} | {known}{since} |"


def _array_row(array: Column) -> str:
    shape = f"({', '.join(array.axes)}{',' * (len(array.axes) == 1)})"
    return f"| `/{array.name}` | {shape} | {_type(array)} | {array.unit} | {array.meaning} |"


def _type(column: Column) -> str:
    return TYPES.get(column.type, f"text of at most {column.type[1:]} characters")


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.add_directive("column-table", ColumnTable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
