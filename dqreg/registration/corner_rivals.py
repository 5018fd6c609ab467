"""Between two clouds that have a corner in common alone: other corners on which a scan may be laid as well.

Three planes fix a pose and leave nothing to check it by but where their faces end; of a part that is nearly symmetric
these end alike after a quarter or half of a turn. From nothing such a pose is found by how much of both it lays on each
other. One that lays less there, where nothing speaks against it, may be the right one.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from dqreg._arrays import FloatArray, product, quantile
from dqreg._records import replaced
from dqreg.geometry import PointCloud
from dqreg.kernels.threads import TimeUpError, until
from dqreg.registration.assess import evidence_of, uncertainty_of, verdict_on
from dqreg.registration.between_clouds import have_planes_alone, planes_of
from dqreg.registration.displacement import displacement_between, is_elsewhere
from dqreg.registration.fallback import BestPoses, is_sound
from dqreg.registration.fit import Fit
from dqreg.registration.free_space import looked_through_at
from dqreg.registration.kept_start import LEFT_DIAGONALS
from dqreg.registration.rivals import NO_POSES, but_symmetric
from dqreg.rigid import pose
from dqreg.search.axes import cube_rotations
from dqreg.search.oriented_points import OrientedPoints
from dqreg.search.poses import Poses
from dqreg.search.refine import refine
from dqreg.trust.common_planes import CORNER_PLANES
from dqreg.trust.limits import DEPTH_CONFLICT_SHARE
from dqreg.trust.records import Code

# What a verdict says of a pose that too little speaks for, and nothing against.
TOO_LITTLE: frozenset[Code] = frozenset({"unconstrained", "large_uncertainty", "weakly_constrained", "not_converged"})
# Share of the points beyond either end of what both show that is left out.
OUTER_SHARE = 1e-3
# Share of the common places that three planes hold, where others hold hardly more than chance.
CORNER_SHARE = 0.9
# Refinement of the poses, on a sample.
REFINING_POINTS, REFINEMENT_STEPS = 1_000, 10
FIRST_SCALE_DIAGONALS, LAST_SCALE_DIAGONALS = 0.01, 1e-3
# Share of the scan on the target, and of what is near it, below which no verdict is asked for.
MIN_SHARE_ON, MIN_SHARE_NEAR = 0.2, 0.9


def beside_corners(known: BestPoses, start: FloatArray | None) -> BestPoses:
    """The best poses, with the other corners that a scan may be laid on where no initial pose meant this one."""
    fit, others = known.fit, NO_POSES
    if fit.target.kind != "cloud" or not fit.found or fit.is_late:
        return known
    if start is not None and not is_elsewhere(fit, fit.T_target_source, start):
        return known
    with suppress(TimeUpError), until(fit.problem.watch.deadline):
        # What the verdict refuses needs no other reason.
        if have_planes_alone(fit) and is_sound(fit):
            others = corner_rivals(fit)
    return replaced(known, turned=np.concatenate([known.turned, others]))


def corner_rivals(fit: Fit) -> FloatArray:
    """Poses of the scan on other corners that nothing speaks against, (k, 4, 4): none where more is in common."""
    options = fit.problem.options
    planes, target = planes_of(fit), fit.target.geometry
    if options.method != "auto" or fit.constraints.any or not isinstance(target, PointCloud):
        return NO_POSES
    if planes is None or not planes.are_all or sum(planes.shares[:CORNER_PLANES]) < CORNER_SHARE:
        return NO_POSES
    begun = _turned(fit, target.points, np.array([plane.normal for plane in planes.planes]))
    size, points = fit.prepared.surface.diagonal, fit.prepared.scan.thinned(REFINING_POINTS).points
    widths = np.geomspace(FIRST_SCALE_DIAGONALS, LAST_SCALE_DIAGONALS, REFINEMENT_STEPS) * size
    ended = refine(Poses.of(begun), OrientedPoints.on_faces(points), fit.prepared.surface, widths).matrices
    found = []
    for T, refined in zip(begun, ended, strict=True):
        # What little holds slides off in the refinement, and a corner whose faces end elsewhere is off before it.
        both = [T, refined] if displacement_between(fit, T, refined) <= LEFT_DIAGONALS else [T]
        for each in but_symmetric(fit, np.stack(both)):
            if _is_open(fit.at(each)):
                found.append(each)
                break
    return np.array(found).reshape(-1, 4, 4)


def _turned(fit: Fit, target: FloatArray, normals: FloatArray) -> FloatArray:
    """The pose after the turns of a cube that has faces along normals, (n, 3), about the middle of what both show.

    Shapes: returns (23, 4, 4).
    """
    one = normals[0]
    other = normals[1] if len(normals) > 1 else np.eye(3)[np.abs(one).argmin()]
    other = other - (one @ other) * one
    other /= np.linalg.norm(other)
    axes = np.stack([one, other, np.cross(one, other)])
    placed = pose.apply(fit.T_target_source, fit.prepared.scan.points)
    points = product(np.concatenate([placed, target]), axes.T)
    middle = np.array([0.5 * (quantile(x, OUTER_SHARE) + quantile(x, 1.0 - OUTER_SHARE)) for x in points.T]) @ axes
    turns = [axes.T @ R @ axes for R in cube_rotations() if not np.array_equal(R, np.eye(3))]
    return np.array([pose.from_parts(R, middle - R @ middle) @ fit.T_target_source for R in turns])


def _is_open(fit: Fit) -> bool:
    """Whether nothing speaks against a pose, though little may speak for it."""
    agreement = fit.agreement
    if agreement.share_on < MIN_SHARE_ON or agreement.share_near < MIN_SHARE_NEAR:
        return False
    through = looked_through_at(fit)[0]
    if through > DEPTH_CONFLICT_SHARE:
        return False
    verdict = verdict_on(fit, evidence_of(fit, uncertainty_of(fit)))
    # Both sides of a wall are faces apart that are none: where nothing was looked through, that tells.
    none: set[Code] = {"faces_apart"} if np.isfinite(through) else set()
    return verdict.level == "accepted" or (TOO_LITTLE | none).issuperset(verdict.codes)
