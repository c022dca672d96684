"""How the documents are built: `make docs`."""

import doctest
import os
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parent / "extensions"), str(Path(__file__).parents[1])]
# The notebook calls the `labctl` of the environment that builds the documents.
os.environ["PATH"] = os.pathsep.join((str(Path(sys.executable).parent), os.environ["PATH"]))

project = "labctl"
author = "The labctl developers"
extensions = [
    "architecture",
    "bench_drawing",
    "column_tables",
    "command_tables",
    "figures",
    "mathml",
    "parameter_table",
    "screenshots",
    "typed",
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.doctest",
    "sphinx.ext.napoleon",
]
exclude_patterns = ["extensions"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
autodoc_member_order = "bysource"
autodoc_typehints = "description"
# Methods that scikit-learn puts on estimators, with references into its own manual.
autodoc_default_options = {"exclude-members": "set_partial_fit_request, set_score_request"}
napoleon_use_ivar = True
linkcheck_ignore = [r"https?://.*"]  # only what lies here: the build works offline
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_timeout = 300
doctest_default_flags = doctest.ELLIPSIS | doctest.DONT_ACCEPT_TRUE_FOR_1  # what an error says counts too
# Examples run where the run is that the build measures.
doctest_global_setup = f"import os; os.chdir({str(Path(__file__).parent / 'made')!r})"
graphviz_output_format = "svg"
html_math_renderer = "mathml"
html_theme = "furo"
html_title = "labctl"
html_show_copyright = False
html_show_sphinx = False
