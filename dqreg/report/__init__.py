"""What a person sees of a registration: the table of iterations and the summary, on a terminal or in a pipe."""

from __future__ import annotations

from dqreg.report.progress import Progress, make_progress
from dqreg.report.summary import print_summary, summary_rows

__all__ = ["Progress", "make_progress", "print_summary", "summary_rows"]
