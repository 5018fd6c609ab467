"""How far a global search came: all words that a stage may be, so that mypy refuses any other."""

from __future__ import annotations

from typing import Literal

SearchStage = Literal[
    "",  # There was no search
    "proposed",
    "screened",
    "refined roughly",
    "refined",
    "turned",
    "refined finely",
    "judged",  # All poses that were left were compared
]


def is_finished(stage: SearchStage) -> bool:
    """Whether no time limit ended the search after this stage: all was compared, or nothing was searched."""
    return stage in ("", "judged")
