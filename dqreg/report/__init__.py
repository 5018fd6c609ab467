"""What a person sees of a registration: iterations and summary on a terminal, a page, pictures, a window, a notebook.

Only the terminal's part is imported here; `dqreg.report.page`, `dqreg.report.pictures`, `dqreg.report.window` and
`dqreg.report.page` are loaded by what needs them.
"""

from __future__ import annotations

from dqreg.report.progress import StepDisplay, make_progress
from dqreg.report.summary import print_summary, summary_rows

__all__ = ["StepDisplay", "make_progress", "print_summary", "summary_rows"]
