"""How far a fit can be trusted: its uncertainty, and the evidence for the verdict, each made in one call."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray, dot
from dqreg._records import replaced
from dqreg._statuses import SearchStage
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import row_dots
from dqreg.registration.assessment.drift import STILL, drift_at
from dqreg.registration.assessment.one_way_constraints import held_both_ways
from dqreg.registration.constrained_motions import own_normals
from dqreg.registration.fit.fit import Fit
from dqreg.registration.fit.loop_status import status_of
from dqreg.registration.other_poses.exposures import second_pose
from dqreg.registration.other_poses.rivals import gain_if_freed
from dqreg.registration.other_poses.slides import slide_of
from dqreg.registration.other_poses.wall_sides import may_confuse_sides
from dqreg.registration.overlap.cloud_overlap import evidence_between_clouds, have_planes_alone
from dqreg.registration.overlap.common_faces import spread_on_common_faces
from dqreg.registration.overlap.free_space import looked_through_at, viewpoint_behind
from dqreg.registration.problem.derived_values import Key
from dqreg.trust import (
    Evidence,
    Information,
    covariance_of,
    judge,
    observe_directions,
)
from dqreg.trust.covariance import partial_information_of
from dqreg.trust.limits import MIRROR_GAIN, is_rough
from dqreg.trust.neighbourhoods import is_flat
from dqreg.trust.records import Alternative, Direction, Verdict

# A scan whose inliers spread less than this share of the target's spread shows a detail of it; points that tell.
PARTIAL, SPREAD = 0.6, 2_000
# A scan whose standard deviation across its plane is below so many widths of its distances is flat.
FLAT_WIDTHS = 2.0


@dataclasses.dataclass(frozen=True)
class Uncertainty:
    """How sure a pose is."""

    covariance: FloatArray  # (6, 6): See `Registration.covariance`
    directions: tuple[Direction, ...]  # The six motions, the weakest first
    partial_information: FloatArray | None = None  # (6, 6): See `Registration.partial_information`

    @staticmethod
    def of(information: Information, units: str | None = None) -> Uncertainty:
        """What follows from the information of the six motions; words name lengths in those units."""
        is_free = information.free.any() and np.isnan(information.by_rims)
        partial = partial_information_of(information) if is_free else None
        return Uncertainty(covariance_of(information), observe_directions(information, units), partial)


UNCERTAINTY: Key[Uncertainty] = Key(of_pose=True)
MEASURED: Key[Evidence] = Key()
IS_PARTIAL: Key[bool] = Key()
VERDICTS: Key[list[tuple[Evidence, Verdict]]] = Key()


def uncertainty_of(fit: Fit, *, by_rims: bool = True) -> Uncertainty:
    """Covariance and observability of a fit; NaN and none where no pose was found.

    It may be left out how the rims of a part hold what no normal constrains: the pose is displaced to learn that.
    """
    if not fit.found:
        return Uncertainty(np.full((6, 6), np.nan), ())

    def uncertainty() -> Uncertainty:
        # The pose errs by so much more as residuals follow less of a displacement.
        known, share = fit.information, fit.followed
        scatter, inflation = known.scatter, fit.inflation
        if inflation is not None:
            scatter = inflation @ known.spread @ inflation.T
        scatter = None if scatter is None else scatter / share**2
        of_both = spread_on_common_faces(fit, known)
        scatter = scatter if of_both is None else of_both
        scatter = held_both_ways(fit, known, known.spread / share**2 if scatter is None else scatter)
        rims = slide_of(fit).by_rims if by_rims else np.nan
        known = replaced(known, sigma=known.sigma / share, scatter=scatter, by_rims=rims)
        return Uncertainty.of(known, fit.problem.units[1])

    return fit.derived.once(UNCERTAINTY, uncertainty)


def evidence_of(
    fit: Fit,
    uncertainty: Uncertainty,
    alternatives: tuple[Alternative, ...] = (),
    *,
    search: SearchStage = "",
    mirror_gain: float = -np.inf,
) -> Evidence:
    """All that the verdict on a fit is made of; see `Evidence` for the meaning of each number."""
    measured = fit.derived.once(MEASURED, lambda: _measured(fit, uncertainty.covariance))
    if fit.constraints.any and (mirror_gain > MIRROR_GAIN or is_rough(measured)):
        gain, rad, shift = gain_if_freed(fit)
        measured = replaced(measured, freed_gain=gain, freed_rad=rad, freed_shift=shift)
    if search and _may_be_turned_over(fit):
        measured = replaced(measured, largest_plane=1.0)
    return replaced(
        measured,
        directions=uncertainty.directions,
        carriers=tuple(fit.information.carriers.tolist()) if uncertainty.directions else (),
        sliding_loss=slide_of(fit).loss,
        alternatives=alternatives,
        search=search,
        is_detail=measured.share_together > 0.0 and is_partial(fit),
        mirror_gain=mirror_gain,
    )


def _may_be_turned_over(fit: Fit) -> bool:
    """Whether the scan of a part lies in one plane and nothing tells its sides."""
    if not fit.found or fit.run.pairs.same_sign or fit.problem.viewpoints is not None or fit.between_clouds:
        return False
    points = fit.prepared.scan.points
    spreads = np.linalg.eigvalsh(np.cov(points[sample_rows(len(points), SPREAD)].T))
    return bool(spreads[0] <= (FLAT_WIDTHS * fit.run.mixture.scale) ** 2)


def _measured(fit: Fit, covariance: FloatArray) -> Evidence:
    """What the fit and its covariance tell alone."""
    drift, drift_rad, drift_along = max(drift_at(fit), (*second_pose(fit), STILL))
    looked_through, seen_alike = looked_through_at(fit, by_rays=have_planes_alone(fit))
    measured = evidence_between_clouds(fit, covariance)
    if measured.patches_deformed and may_confuse_sides(fit):
        # A face on the wrong side of its wall lies on the other one, but for where it bends.
        measured = replaced(measured, patches_deformed=0.0, share_deformed=0.0)
    return replaced(
        measured,
        status=status_of(fit),
        max_distance=fit.settings.max_distance,
        units=fit.problem.units[1],
        carriers_of_both=own_normals(fit.prepared.surface, fit.run.pairs) is not None,
        clutter=fit.problem.options.clutter,
        is_scene=fit.has_border or fit.is_scene,
        looked_through=looked_through,
        seen_alike=seen_alike,
        viewpoint_behind=viewpoint_behind(fit.problem),
        drift=drift,
        drift_rad=drift_rad,
        drift_along=drift_along,
    )


def is_partial(fit: Fit) -> bool:
    """Whether the scan shows so little of the target that it may fit elsewhere, where no near symmetry leads to."""
    return fit.derived.once(IS_PARTIAL, lambda: _is_partial(fit))


def _is_partial(fit: Fit) -> bool:
    if not fit.found:
        return False
    rows = sample_rows(len(fit.run.weights), SPREAD)
    points, weights = np.take(fit.run.pairs.moved, rows, axis=0), fit.run.weights[rows]
    if not weights.any():
        return False
    total = float(weights.sum())
    arms = points - weights @ points / total
    spread = dot(weights, row_dots(arms, arms)) / total
    whole = float((fit.problem.target.spreads**2).sum())
    return bool(
        spread < PARTIAL**2 * whole
        or (
            is_flat(arms if (kept := weights > 0.0).all() else arms[kept])
            and not any(motion.is_free for motion in uncertainty_of(fit).directions)
        )
    )


def verdict_on(fit: Fit, evidence: Evidence) -> Verdict:
    """The verdict; what the second try has asked already is not asked again."""
    # Other poses are arrays, by which nothing is compared; and to hash an evidence takes longer than to compare two.
    if evidence.alternatives:
        return judge(evidence)
    judged = fit.derived.once(VERDICTS, list)
    for before, verdict in judged:
        if before == evidence:
            return verdict
    judged.append((evidence, judge(evidence)))
    return judged[-1][1]
