"""Figures without any global state: one palette, one canvas, one way to a file."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito (2008): told apart by all kinds of colour vision; the yellow of the set is too pale for lines.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#555555")
# Scans are noise, which PNG cannot pack; at this quality no figure can be told from its PNG.
JPEG = {"quality": 86, "optimize": True}


def new_figure(width: float, height: float, dpi: float, layout: str | None = "constrained") -> Figure:
    """An empty figure of so many inches, on a canvas of its own."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    options: dict[str, Any] = {} if layout is None else {"layout": layout}
    figure = Figure(figsize=(width, height), dpi=dpi, **options)
    FigureCanvasAgg(figure)
    return figure


def encode(figure: Figure, kind: str = "png") -> bytes:
    """A figure as a file: png, jpeg, svg or pdf."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format=kind, dpi=figure.dpi, pil_kwargs=JPEG if kind == "jpeg" else None)
    return buffer.getvalue()


def style_axes(axes: Axes) -> None:
    """A light grid below the data, and no frame where no scale stands."""
    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
