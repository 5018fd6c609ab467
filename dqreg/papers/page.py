"""A report as one HTML file that needs nothing else: styles and figures are inside."""

from __future__ import annotations

import base64
import importlib.resources
from collections.abc import Mapping

from dqreg.papers.cells import cell_text, is_number
from dqreg.papers.document import Report


def to_html(report: Report, pictures: Mapping[str, bytes]) -> str:
    """Page of a report."""
    import jinja2

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = importlib.resources.files("dqreg.papers").joinpath("page.html").read_text(encoding="utf-8")
    encoded = {key: base64.b64encode(png).decode("ascii") for key, png in pictures.items()}
    template = environment.from_string(source)
    return template.render(report=report, pictures=encoded, cell_text=cell_text, is_number=is_number)
