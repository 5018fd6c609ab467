"""How an iteration ended: all words that a `status` may be, so that mypy refuses any other."""

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
