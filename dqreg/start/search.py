"""The search for a start: proposals from pairs and axes, refined on few points, ranked by how well they explain it."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud, Scan, Surface
from dqreg.icp import InlierMixture, Level, Plan, Run, Schedule, find_basin, width_floor
from dqreg.rigid import pose
from dqreg.start.axes import propose_turns
from dqreg.start.pairs import PairTable, propose

# Points that refine all proposals, and that compare the best of them.
SCREEN, COMPARE = 500, 2_000
# Proposals that are compared on more points.
KEPT = 4
# A mean log-likelihood this close to the best explains the scan as well.
AS_GOOD = 0.05
# Poses closer than this, in radians and in sizes of the target, are the same.
SAME_ANGLE_RAD, SAME_OFFSET = np.deg2rad(5.0), 0.02
# Pairs bring the pose near, so their refinement looks no farther than this, in largest distances.
NEAR = 0.25

_REFINING = Schedule("search", stages=30, iterations=None, rounds=30)


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A start pose and how badly it explains the scan after a short run.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        The pose after the short run.
    surprise : float
        Mean negative log-likelihood of the distances; the lower the better.
    rms : float
        Width of the inliers, a length.
    """

    T_target_source: FloatArray
    surprise: float
    rms: float


def search(
    scan: Scan, surface: Surface, target: PointCloud | Mesh, plan: Plan, table: PairTable, rng: np.random.Generator
) -> tuple[Candidate, ...]:
    """Start poses that explain the scan about as well as the best one, the best first.

    Parameters
    ----------
    scan : Scan
        Source.
    surface : Surface
        Target.
    target : PointCloud or Mesh
        The same target, for its principal axes.
    plan : Plan
        Parts of the loop and its largest distance.
    table : PairTable
        The target's pairs.
    rng : numpy.random.Generator
        Source of randomness.

    Returns
    -------
    tuple of Candidate
        One or more distinct poses; empty if nothing found correspondences.
    """
    close = dataclasses.replace(plan, max_distance=NEAR * plan.max_distance)
    proposals = [(T, close) for T in propose(scan, table, rng)]
    if not proposals:
        # No two normals stand at an angle to the line between their points: a sphere seen whole, a flat plate.
        proposals = [(T, plan) for T in propose_turns(scan, target)]
    few = scan.thinned(SCREEN)
    refined = [_refine(few, surface, T, reach, plan) for T, reach in proposals]
    ranked = sorted((c for c in refined if c is not None), key=lambda candidate: candidate.surprise)
    more = Level(scan.thinned(COMPARE), surface, close, width_floor(scan, surface), last=False)
    compared = []
    for candidate in _distinct(ranked, scan, surface)[:KEPT]:
        run, mixture = find_basin(more, candidate.T_target_source)
        if not run.ended_early:
            compared.append(Candidate(run.T_target_source, more.surprise(mixture, run), mixture.scale))
    compared.sort(key=lambda candidate: candidate.surprise)
    good = [c for c in compared if c.surprise <= compared[0].surprise + AS_GOOD]
    return tuple(_distinct(good, scan, surface))


def _refine(few: Scan, surface: Surface, T: FloatArray, reach: Plan, plan: Plan) -> Candidate | None:
    # Here the order counts, not the digits: no sharper than a hundredth of the part.
    coarse = max(few.spacing, 1e-2 * surface.diagonal)
    level = Level(few, surface, reach, coarse, last=False)
    run, mixture = level.descend(
        InlierMixture(0.5 * reach.max_distance, 0.5, reach.max_distance), T, _REFINING, None, 1
    )
    if run.ended_early:
        return None
    # All are ranked with one and the same reach: the likelihood depends on it.
    common = dataclasses.replace(level, plan=plan)
    return Candidate(run.T_target_source, common.surprise(*_at(common, mixture, run)), mixture.scale)


def _at(level: Level, mixture: InlierMixture, run: Run) -> tuple[InlierMixture, Run]:
    one = Schedule("search", stages=1, iterations=1, rounds=1)
    common = dataclasses.replace(mixture, limit=level.plan.max_distance)
    again, _ = level.descend(common, run.T_target_source, one, None, 1)
    return common, again


def _distinct(candidates: list[Candidate], scan: Scan, surface: Surface) -> list[Candidate]:
    centre = scan.points.mean(axis=0)
    kept: list[Candidate] = []
    for candidate in candidates:
        T = candidate.T_target_source
        if not any(
            pose.angle_between(T, other.T_target_source) < SAME_ANGLE_RAD
            and pose.offset_between(T, other.T_target_source, at=centre) < SAME_OFFSET * surface.diagonal
            for other in kept
        ):
            kept.append(candidate)
    return kept
