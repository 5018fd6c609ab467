"""A comparison as one HTML file that needs nothing else; every text in it is escaped."""

from __future__ import annotations

import base64
import importlib.resources
from collections.abc import Sequence

from dqreg.compare.plots import Plot
from dqreg.compare.tables import Table


def to_html(title: str, made: Sequence[Table], pictures: Sequence[Plot], note: str, command: str = "") -> str:
    """Page of a comparison."""
    import jinja2

    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    source = importlib.resources.files("dqreg.compare").joinpath("page.html").read_text(encoding="utf-8")
    shown = [(plot, base64.b64encode(plot.png).decode("ascii")) for plot in pictures]
    return environment.from_string(source).render(title=title, tables=made, plots=shown, note=note, command=command)
