"""How an iteration ended, and how far a global search came: all words for it, so that mypy refuses any other."""

from __future__ import annotations

from typing import Literal

Status = Literal[
    "closed form",  # No iteration was needed
    "converged",
    "stalled",  # The step size stopped decreasing
    "iteration limit",
    "time limit",
    "stopped by observer",
    "no correspondences",
    "degenerate correspondences",  # On a line, or at one point
    # No loop was run: of a pair, or a frame of a drive.
    "not run",
    "first frame",
    "no points",
    "too few points",
]
# Ways to end that leave no pose to speak of.
NO_POSE: tuple[Status, ...] = ("no correspondences", "degenerate correspondences")
# Ways to end from outside: nothing is run after them.
INTERRUPTED: tuple[Status, ...] = ("stopped by observer", "time limit")
# How far a global search came.
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
