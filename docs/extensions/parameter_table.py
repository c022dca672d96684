"""The directive `parameter-table`: every parameter of the simulated bench with default, unit and reason."""

from docutils import nodes
from docutils.statemachine import StringList
from pydantic.fields import FieldInfo
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

from sim_backends.parameters import Parameters


class ParameterTable(SphinxDirective):
    """One row a parameter, in the order of the light's way."""

    def run(self) -> list[nodes.Node]:
        """The table."""
        rows = [_row(name, field) for name, field in Parameters.model_fields.items()]
        lines = ["| parameter | default | unit | reason |", "|---|---|---|---|", *rows]
        return self.parse_text_to_nodes(StringList(lines, "sim_backends/parameters.py"))


def _row(name: str, field: FieldInfo) -> str:
    extra = field.json_schema_extra
    unit = extra.get("unit", "") if isinstance(extra, dict) else ""
    value = f"{field.default:g}" if isinstance(field.default, float) else f"{field.default}"
    return f"| `{name}` | {value} | {unit} | {(field.description or '').replace('|', ' ')} |"


def setup(app: Sphinx) -> dict[str, bool]:
    """Sphinx calls this."""
    app.add_directive("parameter-table", ParameterTable)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
