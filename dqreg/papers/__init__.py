"""Two papers reproduced: their tables, figures and formulas, ours beside theirs.

- `reproduce` answers all questions of a paper and gives a `Report`: plain data, computed once.
- `print_section` shows it on the screen; `prepare_folder` and `write_report` write it as JSON, PNG and one HTML page.
- `PAPERS` lists the papers and their questions; each question has a module that measures and words it.
"""

from __future__ import annotations

from dqreg.papers.document import Figure, Report, Section
from dqreg.papers.output import prepare_folder, print_section, write_report
from dqreg.papers.reproduce import PAPERS, reproduce
from dqreg.report.table import Estimate, Table

__all__ = [
    "PAPERS",
    "Estimate",
    "Figure",
    "Report",
    "Section",
    "Table",
    "prepare_folder",
    "print_section",
    "reproduce",
    "write_report",
]
