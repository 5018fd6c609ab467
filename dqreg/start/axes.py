"""A start from nothing: centre on centre and principal axes on principal axes, in all 24 proper turns.

It needs a scan that shows enough of the part for its axes to mean something; a scan of one side, or of a scene, does
not.
"""

from __future__ import annotations

import dataclasses
import itertools

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud, Scan, Surface
from dqreg.icp import InlierMixture, Level, Plan, Run, Schedule, find_basin, width_floor
from dqreg.rigid import pose

# Points that screen the 24 turns, and that compare the best of them.
SCREEN, COMPARE = 500, 2_000
# Turns that are compared on more points.
KEPT = 4
# A mean log-likelihood this close to the best explains the scan as well.
AS_GOOD = 0.05
# Poses closer than this, in radians and in sizes of the target, are the same.
SAME_ANGLE_RAD, SAME_OFFSET = np.deg2rad(5.0), 0.02

# Patient, because centres of a partial scan and of the whole part do not agree.
_SCREENING = Schedule("search", stages=30, iterations=None, rounds=30)


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


def search_axes(scan: Scan, surface: Surface, target: PointCloud | Mesh, plan: Plan) -> tuple[Candidate, ...]:
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
        Parts of the loop; its largest distance is used as it is.

    Returns
    -------
    tuple of Candidate
        One or more distinct poses; empty if none of the turns found correspondences.
    """
    source_mean, source_axes = principal_axes(*_moments(scan))
    target_mean, target_axes = principal_axes(*_moments(target))
    screened = []
    # Screening need not be sharper than a hundredth of the part: only the order of the candidates counts.
    coarse = max(scan.spacing, 1e-2 * surface.diagonal)
    few = Level(scan.thinned(SCREEN), surface, plan, coarse, last=False)
    more = Level(scan.thinned(COMPARE), surface, plan, width_floor(scan, surface), last=False)
    wide = InlierMixture(0.5 * plan.max_distance, 0.5, plan.max_distance)
    for turn in proper_turns():
        R = target_axes @ turn @ source_axes.T
        start = pose.from_parts(R, target_mean - R @ source_mean)
        run, mixture = few.descend(wide, start, _SCREENING, None, 1)
        if not run.ended_early:
            screened.append(_candidate(few, run, mixture))
    screened.sort(key=lambda candidate: candidate.surprise)
    compared = []
    for candidate in _distinct(screened, scan, surface)[:KEPT]:
        run, mixture = find_basin(more, candidate.T_target_source)
        if not run.ended_early:
            compared.append(_candidate(more, run, mixture))
    compared.sort(key=lambda candidate: candidate.surprise)
    good = [c for c in compared if c.surprise <= compared[0].surprise + AS_GOOD]
    return tuple(_distinct(good, scan, surface))


def proper_turns() -> list[FloatArray]:
    """The 24 rotations that map the coordinate axes onto each other, (3, 3) each.

    Returns
    -------
    list of ndarray
        Rotation matrices, determinant +1.

    Examples
    --------
    >>> len(proper_turns())
    24
    """
    turns = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.eye(3)[list(order)] * np.array(signs)
            if np.linalg.det(R) > 0.0:
                turns.append(R)
    return turns


def principal_axes(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and right-handed principal axes, one a column, of a distribution.

    Parameters
    ----------
    mean : ndarray, (3,)
        Its mean.
    covariance : ndarray, (3, 3)
        Its covariance.

    Returns
    -------
    mean : ndarray, (3,)
        As given.
    axes : ndarray, (3, 3)
        Rotation matrix whose columns are the axes, the shortest first.
    """
    _, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return mean, axes


def _moments(shape: Scan | PointCloud | Mesh) -> tuple[FloatArray, FloatArray]:
    if isinstance(shape, Mesh):
        # Exact moments of the surface: a triangle's second moment is a twelfth of its corners' scatter.
        weights = shape.face_areas / shape.face_areas.sum()
        centres = shape.corners.mean(axis=1)
        spread = shape.corners - centres[:, None, :]
        mean = weights @ centres
        within = np.einsum("f,fki,fkj->ij", weights, spread, spread) / 12.0
        between = (centres - mean).T @ ((centres - mean) * weights[:, None])
        return mean, within + between
    return shape.points.mean(axis=0), np.cov(shape.points.T)


def _candidate(level: Level, run: Run, mixture: InlierMixture) -> Candidate:
    return Candidate(run.T_target_source, level.surprise(mixture, run), mixture.scale)


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
