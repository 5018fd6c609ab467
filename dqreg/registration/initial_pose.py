"""The initial pose: the one that was given, or what global registration finds."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from contextlib import suppress

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._records import forget, remembered
from dqreg._statuses import SearchStage, is_finished
from dqreg.geometry import Scan
from dqreg.icp.stopwatch import Stopwatch
from dqreg.kernels.kept import Kept
from dqreg.kernels.threads import TimeUpError, until
from dqreg.registration.options.constraints import PoseConstraints
from dqreg.registration.options.options import Options
from dqreg.registration.overlap.free_space import both_rays
from dqreg.registration.problem.derived_values import Key
from dqreg.registration.problem.preparation import Prepared
from dqreg.registration.problem.problem import Problem
from dqreg.registration.problem.target_index import TargetIndex
from dqreg.search import Candidate, PairTable, search
from dqreg.trust.rays import BothRays

# How near the global search comes to the pose, in diagonals of the target.
FOUND = 5e-3
# Of a time limit a search leaves so many times what preparing took, at most half of what is left, to the loop and the
# verdict: these ask the same points on the same machine.
AFTER, HALF = 4.0, 0.5
# Points of each of two clouds that rays of the other are asked of, for many poses.
LOOKED_AT = 1_500

# Of a target.
PAIRS: Key[Kept[PairTable]] = Key()


def drop_pairs(target: TargetIndex) -> None:
    """Free what a search looks up, some 13 MB whatever the points: a later search of this target makes it anew."""
    forget(target, "pairs")
    target.derived.drop(PAIRS)


@dataclasses.dataclass(frozen=True)
class GlobalSearch:
    """A global search that is ready to run, and runs only if it is asked to."""

    scan: Scan
    target: TargetIndex
    options: Options
    max_distance: float
    watch: Stopwatch
    # What the rays of two clouds met; None where their places are not known, or their sizes
    rays: Callable[[], BothRays | None] = lambda: None
    is_kept: bool = False  # Whether the target is one for other scans too

    @staticmethod
    def of(problem: Problem, prepared: Prepared) -> GlobalSearch:
        """The search for the initial pose of a problem."""
        # Poses are compared by what all of the scan says, whatever distances the loop was asked to keep to.
        reach, rays = problem.reach(prepared), functools.partial(both_rays, problem)
        return GlobalSearch(prepared.scan, problem.target, problem.options, reach, problem.watch, rays, problem.is_kept)

    @property
    def kernel_scale(self) -> float | None:
        """Scale of the kernel with which to go on from what was found; a chosen method finds its own."""
        # Not of the surface: where cells stand for a cloud, nobody else asks for one of all points.
        return FOUND * self.target.diagonal if self.options.method == "auto" else None

    def candidates(self, known: FloatArray | None = None, *, behind: bool = False) -> tuple[Candidate, ...]:
        """Poses between the centred frames, the best first; beside known ones, (k, 4, 4); with those behind."""
        target, noise, rays = self.target, self.scan.noise, None
        with suppress(TimeUpError), until(self.watch.deadline):
            rays = self.rays()

        def through(poses: FloatArray, slack: float) -> FloatArray:
            assert rays is not None
            return rays.met(poses, noise, LOOKED_AT, slack).through

        return search(
            self.scan,
            target.surface,
            target.geometry,
            self.options.icp_settings(self.max_distance, PoseConstraints()),
            self._pairs,
            np.random.default_rng(self.options.seed),
            time_limit=self.time_limit,
            observe=self.options.observe_search,
            through=None if rays is None else through,
            known=known,
            behind=behind,
        )

    def _pairs(self) -> PairTable:
        """The target's; those of a prepared one are made to the end, whatever the time: a later search needs them."""
        target = self.target
        if not self.is_kept or remembered(target, "pairs") is not None:
            return target.pairs
        return target.derived.once(PAIRS, lambda: Kept(lambda: target.pairs)).result()

    @property
    def time_limit(self) -> float | None:
        """Seconds that the search may take; None without a limit."""
        left = self.watch.left
        return None if left is None else max(left - AFTER * self.watch.seconds.get("prepare", 0.0), HALF * left)


@dataclasses.dataclass(frozen=True)
class InitialPose:
    """Where the loop starts, and what the search for it knows."""

    T_target_source: FloatArray  # (4, 4): Between the centred frames
    kernel_scale: float | None = None  # Scale of the kernel to start with; None where the loop finds it
    others: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 4, 4)))  # (k, 4, 4): Equally likely
    search: SearchStage = ""  # Stage in which the search ended
    # (k, 4, 4): Poses in a scene that explain less of it, one of which may be the part's
    unlikely: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 4, 4)))
    # (k, 4, 4): Poses on a part that explain less, but might as much on other sides of thin walls
    behind: FloatArray = dataclasses.field(default_factory=lambda: np.zeros((0, 4, 4)))

    @property
    def is_judged(self) -> bool:
        """Whether no time limit ended the search for it."""
        return is_finished(self.search)


def initial_pose(problem: Problem, global_search: GlobalSearch) -> InitialPose:
    """The initial pose that was given, else the best that the search finds."""
    if problem.start is not None:
        return InitialPose(problem.to_centred(problem.start))
    found = global_search.candidates(behind=True)
    if not found:
        return InitialPose(np.eye(4), search="judged")
    others, unlikely, behind = (
        np.array([c.T_target_source for c in found[1:] if (c.is_likely, c.is_behind) == which]).reshape(-1, 4, 4)
        for which in ((True, False), (False, False), (False, True))
    )
    # The search has compared all of the scan with all of the target: the basin is decided.
    kernel_scale = global_search.kernel_scale if found[0].stage == "judged" else None
    return InitialPose(found[0].T_target_source, kernel_scale, others, found[0].stage, unlikely, behind)
