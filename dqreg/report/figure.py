"""Figures without any global state: one palette, one canvas, one way to a file."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito (2008): told apart by all kinds of colour vision; the yellow of the set is too pale for lines.
PALETTE = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#555555")
# Scans are noise, which PNG cannot pack; at this quality no figure can be told from its PNG.
OPTIONS: dict[str, dict[str, Any]] = {
    "jpeg": {"pil_kwargs": {"quality": 86, "optimize": True}},
    "svg": {"metadata": {"Date": None}},
    "pdf": {"metadata": {"CreationDate": None}},
}


def new_figure(width: float, height: float, dpi: float, layout: str | None = "constrained") -> Figure:
    """An empty figure of so many inches, on a canvas of its own."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    options: dict[str, Any] = {} if layout is None else {"layout": layout}
    figure = Figure(figsize=(width, height), dpi=dpi, **options)
    FigureCanvasAgg(figure)
    return figure


def encode(figure: Figure, kind: str = "png") -> bytes:
    """A figure as a file: png, jpeg, svg or pdf; the same bytes whenever it is drawn."""
    from matplotlib import rc_context

    buffer = io.BytesIO()
    options = OPTIONS.get(kind, {})
    # The names in an SVG are random otherwise; publishers refuse fonts of type 3 in a PDF.
    settings: Any = {"svg.hashsalt": "dqreg", "pdf.fonttype": 42} if kind in ("svg", "pdf") else {}
    with rc_context(settings):
        figure.savefig(buffer, format=kind, dpi=figure.dpi, **options)
    return buffer.getvalue()


def stacked(
    painters: Sequence[Callable[[Axes], None]], width: float, heights: Sequence[float], dpi: float
) -> tuple[Figure, list[Axes]]:
    """Axes below each other, each painted and in the style of all figures; lengths in inches."""
    figure = new_figure(width, sum(heights), dpi)
    rows = list(figure.subplots(len(painters), 1, squeeze=False, height_ratios=list(heights))[:, 0])
    for axes, paint in zip(rows, painters, strict=True):
        paint(axes)
        _style(axes)
    return figure, rows


def _style(axes: Axes) -> None:
    """A light grid below the data, no frame where no scale stands, plain numbers on a short logarithmic axis."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axes.grid(visible=True, which="major", color="#dddddd", linewidth=0.7)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() != "log":
            continue
        low, high = sorted(abs(value) for value in axis.get_view_interval())
        if high <= 1e3 * low:
            # Powers of ten alone would be too few.
            axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())
