"""One environment for every page: escaped, strict, and with nothing that is loaded from elsewhere."""

from __future__ import annotations

import base64
import importlib.metadata
import importlib.resources
from functools import cache
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import jinja2
    from markupsafe import Markup


def render(template: str, **values: Any) -> str:
    """A page from a template of this room."""
    return (
        _environment().get_template(template).render(values, asset=asset, version=importlib.metadata.version("dqreg"))
    )


def asset(name: str) -> Markup:
    """Text of a file that pages hold: a stylesheet, a program."""
    from markupsafe import Markup

    return Markup(importlib.resources.files("dqreg.report").joinpath("templates", name).read_text(encoding="utf-8"))


def data_uri(picture: bytes, kind: str = "png") -> str:
    """A picture as the address of itself."""
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode('ascii')}"


@cache
def _environment() -> jinja2.Environment:
    import jinja2

    made = jinja2.Environment(
        loader=jinja2.PackageLoader("dqreg.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["css_text"] = css_text
    return made


def css_text(words: object) -> Markup:
    r"""Words as a string of a stylesheet: what is no letter, digit or blank is written by its number.

    >>> print(css_text('a"</style>'))
    "a\22 \3c \2f style\3e "
    """
    from markupsafe import Markup

    plain = Markup(words).unescape() if isinstance(words, Markup) else str(words)
    return Markup('"' + "".join(c if c.isalnum() or c == " " else f"\\{ord(c):x} " for c in plain.strip()) + '"')
