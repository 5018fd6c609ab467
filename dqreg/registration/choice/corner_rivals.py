"""Between two clouds that have a corner in common alone: other corners on which a scan may be laid as well.

Three planes fix a pose and leave nothing to check it by but where their faces end; of a part that is nearly symmetric
these end alike after a quarter or half of a turn. So do more planes of a prism after one of its steps. From nothing
such a pose is found by how much of both it lays on each other. One that lays less there, where nothing speaks against
it, may be the right one.
"""

from __future__ import annotations

from collections.abc import Sequence, Set
from contextlib import suppress

import numpy as np

from dqreg._arrays import FloatArray, product, quantile
from dqreg._records import replaced
from dqreg.geometry import PointCloud
from dqreg.geometry.normals import sample_rows
from dqreg.kernels.threads import TimeUpError, until
from dqreg.registration.assessment.assess import evidence_of, uncertainty_of, verdict_on
from dqreg.registration.choice.fallback import BestPoses, is_sound
from dqreg.registration.choice.kept_start import LEFT_DIAGONALS
from dqreg.registration.fit.displacement import displacement_between, is_elsewhere
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.rivals import NO_POSES, but_symmetric
from dqreg.registration.overlap.cloud_overlap import have_planes_alone, planes_of
from dqreg.registration.overlap.free_space import looked_through_at
from dqreg.rigid import pose
from dqreg.rigid.rotations import about_axis
from dqreg.search.axes import axes_of_normals, cube_rotations
from dqreg.search.refine import Refinement, refined_on
from dqreg.trust.code_sets import SIDES_OF_WALL, TOO_LITTLE, TOO_LITTLE_IF_REFUSED
from dqreg.trust.common_planes import CORNER_PLANES
from dqreg.trust.limits import DEPTH_CONFLICT_SHARE
from dqreg.trust.records import Verdict

# Share of the points beyond either end of what both show that is left out.
OUTER_SHARE = 1e-3
# Points that tell how far both reach.
END_POINTS = 5_000
# Sides of a prism are across its axis within this cosine; steps between them are at least so large, and whole parts of
# a turn within that angle.
ACROSS_COS, MIN_STEP_RAD = 0.1, np.deg2rad(28.0)
SAME_STEP_RAD = np.deg2rad(3.0)
# Share of the common places that three planes hold, where others hold hardly more than chance.
CORNER_SHARE = 0.9
# Refinement of the poses.
REFINEMENT = Refinement(first=0.01, steps=10)
# Share of the scan on the target, and of what is near it, below which no verdict is asked for.
MIN_SHARE_ON, MIN_SHARE_NEAR = 0.2, 0.9


def beside_corners(known: BestPoses, start: FloatArray | None) -> BestPoses:
    """The best poses, with the other corners that a scan may be laid on where no initial pose meant this one."""
    fit, others = known.fit, NO_POSES
    if not fit.between_clouds or not fit.found or fit.is_late:
        return known
    if start is not None and not is_elsewhere(fit, fit.T_target_source, start):
        return known
    with suppress(TimeUpError), until(fit.problem.watch.deadline):
        if have_planes_alone(fit):
            others = corner_rivals(fit)
    return replaced(known, turned=np.concatenate([known.turned, others]))


def corner_rivals(fit: Fit) -> FloatArray:
    """Poses of the scan on other corners that nothing speaks against, (k, 4, 4): none where more is in common."""
    target = fit.target.geometry
    if not fit.may_be_moved or not isinstance(target, PointCloud):
        return NO_POSES
    planes = planes_of(fit)
    if planes is None or not planes.are_all:
        return NO_POSES
    normals = np.array([plane.normal for plane in planes.planes])
    turns, is_refused = prism_turns(normals), not is_sound(fit)
    if sum(planes.shares[:CORNER_PLANES]) >= CORNER_SHARE:
        turns += _cube_turns(normals)
    if not turns:
        return NO_POSES
    # What speaks against the pose that was found leaves the others as likely.
    but = TOO_LITTLE | set(_verdict(fit).codes) | (TOO_LITTLE_IF_REFUSED if is_refused else set())
    return _open_ones(fit, _turned(fit, target.points, normals, turns), but)


def _open_ones(fit: Fit, begun: FloatArray, but: Set[str]) -> FloatArray:
    """Those of some poses, (k, 4, 4), refined or as they are, that nothing speaks against but some reasons."""
    points = fit.prepared.scan.thinned(REFINEMENT.points).points
    ended = refined_on(begun, points, fit.prepared.surface, REFINEMENT)
    found = []
    for T, refined in zip(begun, ended, strict=True):
        # What little holds slides off in the refinement, and a corner whose faces end elsewhere is off before it.
        both = [T, refined] if displacement_between(fit, T, refined) <= LEFT_DIAGONALS else [T]
        for each in but_symmetric(fit, np.stack(both)):
            if _is_open(fit.at(each), but):
                found.append(each)
                break
    return np.array(found).reshape(-1, 4, 4)


def _cube_turns(normals: FloatArray) -> list[FloatArray]:
    """Rotations of a cube that has faces along normals, (n, 3)."""
    axes = axes_of_normals(*_two_of(normals))
    return [axes.T @ R @ axes for R in cube_rotations() if not np.array_equal(R, np.eye(3))]


def _two_of(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The first two of some normals, (n, 3); of a single one the axis of the coordinates that is most across it."""
    one = normals[0]
    return one, normals[1] if len(normals) > 1 else np.eye(3)[np.abs(one).argmin()]


def prism_turns(normals: FloatArray) -> list[FloatArray]:
    """Rotations of the prism that has an end and sides along normals, (n, 3), but for a cube's.

    A prism shows more faces at once than a corner has, and its turns lay all of them on each other.
    """
    for axis in normals:
        sides = normals[np.abs(normals @ axis) < ACROSS_COS]
        if order := _order(sides):
            steps, flip = about_axis(axis, 2.0 * np.pi / order * np.arange(order)), about_axis(sides[0], np.pi)
            return [*steps[1:], *(steps @ flip)]
    return []


def _order(sides: FloatArray) -> int:
    """Number of sides of a prism that has some of them along normals, (n, 3); 0 for none, and for a cube's."""
    angles = np.arccos(np.clip(np.abs(sides @ sides.T)[np.triu_indices(len(sides), 1)], 0.0, 1.0))
    angles = np.concatenate([angles, np.pi - angles])
    orders = np.round(2.0 * np.pi / angles[angles > MIN_STEP_RAD])
    fits = np.abs(angles[angles > MIN_STEP_RAD] - 2.0 * np.pi / orders) < SAME_STEP_RAD
    return int(orders[fits & (orders != 2.0) & (orders != 4.0)].max(initial=0.0))


def _turned(fit: Fit, target: FloatArray, normals: FloatArray, turns: Sequence[FloatArray]) -> FloatArray:
    """The pose after turns, (3, 3) each, with shifts that lay the ends of what both clouds show on each other.

    Shapes: returns (k, 4, 4).
    """
    placed = pose.apply(fit.T_target_source, fit.prepared.scan.points)
    points = np.concatenate([placed, target])
    points = points[sample_rows(len(points), END_POINTS)]
    if len(normals) < CORNER_PLANES:
        # The faces themselves, square to each other or not, and what is across both.
        one, other = _two_of(normals)
        normals = np.stack([one, other, np.cross(one, other)])
    sides = np.concatenate([normals, -normals])
    ends = _ends(points, sides)
    found = []
    for R in turns:
        turned = sides @ R.T
        shift = np.linalg.lstsq(turned, _ends(points, turned) - ends, rcond=1e-6)[0]
        found.append(pose.from_parts(R, shift) @ fit.T_target_source)
    return np.array(found).reshape(-1, 4, 4)


def _ends(points: FloatArray, directions: FloatArray) -> FloatArray:
    """How far points, (n, 3), reach along directions, (k, 3), but for a few, (k,)."""
    return np.array([quantile(heights, 1.0 - OUTER_SHARE) for heights in product(points, directions.T).T])


def _is_open(fit: Fit, but: Set[str]) -> bool:
    """Whether nothing speaks against a pose but some reasons, though little may speak for it."""
    agreement = fit.agreement
    if agreement.share_on < MIN_SHARE_ON or agreement.share_near < MIN_SHARE_NEAR:
        return False
    through = looked_through_at(fit)[0]
    if through > DEPTH_CONFLICT_SHARE:
        return False
    verdict = _verdict(fit)
    # Where nothing was looked through, that tells.
    none = SIDES_OF_WALL if np.isfinite(through) else frozenset()
    return verdict.level == "accepted" or set(verdict.codes) <= but | none


def _verdict(fit: Fit) -> Verdict:
    return verdict_on(fit, evidence_of(fit, uncertainty_of(fit)))
