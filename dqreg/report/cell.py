"""The report's live view in a cell of a notebook."""

from __future__ import annotations

import dataclasses
from html import escape
from pathlib import Path
from typing import Any

from dqreg.errors import InputError
from dqreg.report.page import NO_SIDES, to_html
from dqreg.report.page_file import page_path, write_page
from dqreg.report.report_data import checked_tolerance, collect
from dqreg.report.result_protocol import RegistrationResult

MIN_HEIGHT_PIXELS, MAX_HEIGHT_PIXELS = 200, 4000


@dataclasses.dataclass(frozen=True)
class NotebookCell:
    """A page that a notebook shows in a frame of its own."""

    html: str  # The page, whole
    height: int  # Of the frame, pixels

    def _repr_html_(self) -> str:
        # Without "allow-same-origin" the page cannot touch the notebook.
        return (
            f'<iframe sandbox="allow-scripts" title="part and scan" srcdoc="{escape(self.html)}" '
            f'style="width:100%;height:{self.height}px;border:0"></iframe>'
        )

    def __repr__(self) -> str:
        return f"Cell({self.height} pixels high)"

    def save(self, path: str | Path) -> Path:
        """Write the page alone."""
        return write_page(page_path(path), self.html)


def cell_of(
    result: RegistrationResult, tolerance: float | None, *, height: int, reach: float | None, start: Any
) -> NotebookCell:
    """The view of a result that holds its sides."""
    checked_tolerance(tolerance)
    if isinstance(height, bool) or not isinstance(height, int) or not MIN_HEIGHT_PIXELS <= height <= MAX_HEIGHT_PIXELS:
        raise InputError(
            f"height must be a whole number of pixels from {MIN_HEIGHT_PIXELS} to {MAX_HEIGHT_PIXELS}; "
            f"got {height!r:.60}"
        )
    if result.inputs is None:
        raise InputError(NO_SIDES)
    return NotebookCell(to_html(result, collect(result, result.inputs, tolerance, start, reach), in_cell=True), height)
