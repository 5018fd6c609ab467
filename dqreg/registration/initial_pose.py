"""Where a registration begins: at the start that was given, or at what the search finds."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, as_pose
from dqreg.errors import InputError
from dqreg.geometry import Scan
from dqreg.icp.stopwatch import Deadline
from dqreg.registration.assess import from_work, to_work
from dqreg.registration.constraints import Known
from dqreg.registration.options import Options
from dqreg.registration.target_index import TargetIndex
from dqreg.search import Candidate, Stage, search, symmetry_words
from dqreg.trust.records import Alternative

# How near the search for a start comes, in diagonals of the target.
FOUND = 5e-3


@dataclasses.dataclass(frozen=True)
class Beginning:
    """Where to begin, between the centred frames, and what the search for it knows."""

    T_work: FloatArray  # (4, 4): Pose to begin at
    width: float | None = None  # Width of the kernel to begin with; None where the loop finds it
    alternatives: tuple[Alternative, ...] = ()  # Other poses that the search found as good, in the caller's frames
    searched: str = ""  # Stage in which the search ended; empty where there was none


@dataclasses.dataclass(frozen=True)
class Searching:
    """A search for a start that is ready to run, and runs only if it is asked to."""

    scan: Scan
    target: TargetIndex
    options: Options
    reach: float
    deadline: Deadline
    observe: Callable[[Stage], object] | None = None

    @property
    def width(self) -> float:
        """Width of the kernel with which to go on from what was found."""
        return FOUND * self.target.surface.diagonal

    def candidates(self) -> tuple[Candidate, ...]:
        """Start poses between the centred frames, the best first."""
        indexed = self.target
        return search(
            self.scan,
            indexed.surface,
            indexed.geometry,
            self.options.plan(self.reach, Known()),
            lambda: self.target.pairs,
            np.random.default_rng(self.options.seed),
            time_limit=self.deadline.left,
            observe=self.observe,
        )


def begin(T_start: FloatArray | None, searching: Searching, origin_source: FloatArray) -> Beginning:
    """Begin at the start that was given, else search for one."""
    origin = searching.target.origin
    if T_start is not None:
        return Beginning(to_work(T_start, origin, origin_source))
    found = searching.candidates()
    if not found:
        return Beginning(np.eye(4), searched="judged")
    others = tuple(
        Alternative(
            from_work(c.T_target_source, origin, origin_source),
            c.rms,
            symmetry_words(c.symmetry.moved(origin)) if c.symmetry else "",
        )
        for c in found[1:]
    )
    # The search has looked at the whole of both sides: what is left is to come near.
    width = searching.width if found[0].stage == "judged" else None
    return Beginning(found[0].T_target_source, width, others, found[0].stage)


def read_start(start: Any, prior: Any, dof: Any) -> FloatArray | None:
    """The pose to begin at, as a caller may give it."""
    if start is None and isinstance(prior, tuple) and len(prior) == 2:
        return as_pose(prior[0], "prior[0]")
    if start is None:
        if dof is not None:
            raise InputError(f"dof={str(dof)!r} locks motions of a start, and there is none: give start, or a prior")
        return None
    if isinstance(start, str):
        if start != "identity":
            raise InputError(f'start must be None, "identity" or a 4x4 pose T_target_source; got {start!r}')
        return np.eye(4)
    return as_pose(start, "start")
