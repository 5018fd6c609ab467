"""Sphinx builds the site from these pages and the docstrings: ``.ci/docs``, or ``sphinx-build docs FOLDER``."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

import dqreg  # noqa: E402

project = "dqreg"
author = "The dqreg developers"
copyright = f"2026, {author}"  # noqa: A001
version = release = dqreg.__version__

extensions = ["sphinx.ext.autodoc", "numpydoc", "myst_nb", "sphinx_copybutton", "mathml", "command_help"]
exclude_patterns = ["_build", "_ext"]
# Single quotes in docstrings name Python objects; what cannot be found stays plain code.
default_role = "py:obj"

html_theme = "furo"
html_title = f"dqreg {release}"
html_static_path = ["_static"]
html_css_files = ["dqreg.css"]
html_theme_options = {"light_css_variables": {"color-brand-primary": "#0b6e99", "color-brand-content": "#0b6e99"}}
html_math_renderer = "mathml"
html_show_sourcelink = False
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True

autodoc_member_order = "bysource"
# Types stand in the docstrings, with shapes and units.
autodoc_typehints = "none"
autodoc_default_options = {"members": True}
numpydoc_show_class_members = False
numpydoc_class_members_toctree = False

myst_enable_extensions = ["dollarmath", "amsmath", "colon_fence", "deflist"]
myst_heading_anchors = 3
# The notebook is run, not believed.
nb_execution_mode = "force"
nb_execution_timeout = 120
nb_execution_raise_on_error = True
# Standard error is for people at a terminal.
nb_output_stderr = "remove"

# External links are asked by .ci/docs where the network lets them be.
linkcheck_timeout = 20
linkcheck_workers = 4


def _bars_are_lengths(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """In docstrings ``|q|`` is a length; reStructuredText would take it for a substitution."""
    for number, line in enumerate(lines):
        parts = re.split("(``.*?``)", line)
        lines[number] = "".join(part if part.startswith("``") else part.replace("|", "\\|") for part in parts)


def setup(app: Any) -> None:
    """Connect what this project needs beside the extensions."""
    app.connect("autodoc-process-docstring", _bars_are_lengths, priority=900)
