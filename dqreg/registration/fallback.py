"""The second try: where a pose is in doubt, others are searched for, asked the same questions, and the best is kept."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.registration.assess import evidence_of, is_partial, uncertainty_of, verdict_on
from dqreg.registration.displacement import FEW, displacement_between
from dqreg.registration.evidence import MISFIT
from dqreg.registration.fit import Fit
from dqreg.registration.free_space import looked_through_at
from dqreg.registration.initial_pose import FOUND, GlobalSearch, InitialPose
from dqreg.registration.rivals import BETTER, NO_POSES, SIGNIFICANT, down_to_noise, is_scene, mirror_gain, scores_of
from dqreg.registration.slides import without_slide
from dqreg.rigid import pose, twist
from dqreg.rigid.rotations import angle_of
from dqreg.rigid.symmetry import SAME_AXIS_RAD
from dqreg.solvers.status import INTERRUPTED
from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import own_noise

# Fraction of the points near a part that lie off it beyond which the same is done: right poses leave 0.002, and half
# of the strays. Fewer than the verdict allows are evidence where they are no strays.
OFF, OFF_PER_STRAY = 0.015, 0.7
# The same of points that lie off it beside each other: outliers do not, and right poses leave none.
TOGETHER = 5e-3
# Fraction of all points off the target, of a scan that is no scene with the part in it, from which on the same is done.
BESIDE = 0.15
# Reasons of a verdict that another pose cannot mend.
OF_THE_SCAN: frozenset[str] = frozenset({"unconstrained", "alternative_poses", "outliers", "not_converged"})
# A better pose is taken if it is within this rotation and this fraction of the target's size of the initial pose that
# was given: that one is rough, but it is meant. Farther off it has to be significantly better.
MEANT_RAD, MEANT = np.deg2rad(40.0), 0.25
# Poses within so much of the best mean log-likelihood explain the scan about as well; within so many standard errors,
# and what is left of refinements that have not quite ended, they are as likely as the best.
AS_WELL, ERRORS, ROUNDING = 0.02, 3.0, 5e-4
# A pose this near to a symmetric copy of another one, in radians and sizes, is that copy.
COPY = 2e-3
# Poses of a search that are refined.
TRIED = 8
# Displacement of a point from the initial pose, in sizes, beyond which the loop between two clouds is in no basin that
# was meant; a rotation by 23 degrees, or less with a shift.
FAR = 0.2
# Points of two clouds near each other, and within their borders, of which so large a share lies apart: right poses of
# one body leave 0.002.
BETWEEN = 0.02


@dataclasses.dataclass(frozen=True)
class Known:
    """The best of the poses that are known."""

    fit: Fit
    others: FloatArray  # (k, 4, 4): Others that explain the scan about as well, between the centred frames
    searched: bool = False  # Whether it was compared with the poses of a global search


def best_known(fit: Fit, start: InitialPose, search: GlobalSearch) -> Known:
    """The best of a fit and, where that is in doubt, of what a global search finds."""
    problem, is_given = fit.problem, fit.problem.start is not None
    known = Known(fit, start.others)
    if problem.watch.is_over or fit.run.status in INTERRUPTED or not start.is_judged:
        return known
    if is_given and not may_search(fit):
        return known
    is_asked = is_given and (problem.options.search == "always" or is_partial(fit) or _is_astray(fit, start))
    beside = np.concatenate([start.others, start.unlikely])
    kernel_scale = search.kernel_scale if problem.options.method == "auto" else None
    if not is_asked and ((not is_given and not len(beside)) or not is_doubtful(fit)):
        return Known(fit, but_on_the_way(fit, start.others, kernel_scale))
    others = np.array([c.T_target_source for c in search.candidates()]).reshape(-1, 4, 4) if is_given else beside
    others = but_slid(fit, others)
    is_copy = _is_copy(fit, others)
    fits, last = [fit], fit
    # A part that is nearly symmetric has copies that are wrong: the points decide, after the other poses.
    for T in others[np.argsort(is_copy, kind="stable")][:TRIED]:
        last = last.resumed(T, kernel_scale)
        if last.problem.watch.is_over:
            break
        # What stands beside the part may hold the kernel wide here too.
        fits.append(without_slide(down_to_noise(last))[0])
    fits, copies = _without_equal_copies(fits)
    known = _best(fits, start.T_target_source if is_given else None)
    if is_partial(fit):
        copies = np.concatenate([copies, _copies(known.fit)])
    return dataclasses.replace(known, others=np.concatenate([known.others, copies]))


def _is_astray(fit: Fit, start: InitialPose) -> bool:
    """Whether a pose between two clouds is one that the initial pose did not mean, or leaves some of both apart.

    Two clouds fit at many poses, with less in common: what lies off the target may be what it does not show. Where the
    place of a scanner is known, its free space tells.
    """
    if fit.target.kind != "cloud" or not fit.found or np.isfinite(looked_through_at(fit)[0]):
        return False
    return (
        fit.agreement.share_near < 1.0 - BETWEEN
        or displacement_between(fit, start.T_target_source, fit.T_target_source) > FAR
    )


def may_search(fit: Fit) -> bool:
    """Whether a global search beside the initial pose is allowed; what was asked for in so many words is done alone."""
    options = fit.problem.options
    return options.search == "always" or (
        options.search == "doubt" and options.method == "auto" and not fit.constraints.any
    )


def is_doubtful(fit: Fit, *, ask_mirror: bool = False) -> bool:
    """Whether something speaks against a pose that another one might mend."""
    return fit.once(("doubtful", ask_mirror), lambda: _is_doubtful(fit, ask_mirror))


def _is_doubtful(fit: Fit, ask_mirror: bool) -> bool:
    if not fit.found:
        return _was_near(fit)
    # Two scans of one scene always differ somewhere, and the noise between them is not known as well.
    if not fit.has_border and _is_off_or_rough(fit.agreement):
        return True
    return _is_beside(fit) or not is_sound(fit, ask_mirror=ask_mirror)


def _is_off_or_rough(found: Evidence) -> bool:
    """Whether some of a scan lies off its part, or it lies there by more than its noise."""
    is_off = found.share_near < 1.0 - OFF - OFF_PER_STRAY * found.strays or found.share_together > TOGETHER
    return is_off or found.width > MISFIT * own_noise(found) > 0.0


def _is_beside(fit: Fit) -> bool:
    """Whether much of a scan no larger than a closed target lies off it: a part upside down leaves its hub so."""
    return not fit.has_border and fit.agreement.share_on < 1.0 - BESIDE and not is_scene(fit)


def is_sound(fit: Fit, *, ask_mirror: bool = False) -> bool:
    """Whether the verdict has nothing against a pose that another one might mend."""
    gain = mirror_gain(fit, always=ask_mirror)
    evidence = evidence_of(fit, uncertainty_of(fit), mirror_gain=gain)
    verdict = verdict_on(fit, evidence)
    # A wrong pose of two clouds often lies on one face, where the right one would have more.
    between = {"unconstrained"} if fit.target.kind == "cloud" else set()
    return verdict.level == "accepted" or (OF_THE_SCAN - between).issuperset(verdict.codes)


def _is_copy(fit: Fit, others: FloatArray) -> BoolArray:
    """Which poses, (k, 4, 4), are the fit's after a symmetry of the part: no scan is explained better there."""
    target = fit.problem.target
    found = np.zeros(len(others), dtype=bool)
    if not len(others) or not fit.found or target.pairs.symmetry is None:
        return found
    for k, T in enumerate(others):
        motion = T @ pose.inverse(fit.T_target_source)
        within = 2.0 * COPY * target.surface.diagonal
        axis, angle = target.pairs.symmetry.between(fit.T_target_source, T, within), angle_of(motion[:3, :3])
        if axis is None or angle < SAME_AXIS_RAD:
            continue
        step = 2.0 * np.pi / axis.order if axis.order else angle
        shift = float(np.linalg.norm(pose.apply(motion, axis.point[None])[0] - axis.point))
        found[k] = max(abs(angle - step * round(angle / step)), shift / target.surface.diagonal) <= COPY
    return found


def but_slid(fit: Fit, others: FloatArray) -> FloatArray:
    """Poses, (k, 4, 4), without those that are the fit's or one another's after a motion that nothing constrains."""
    free = fit.information.free if fit.found else np.zeros(0, dtype=bool)
    if not len(others) or not free.any():
        return others
    scores = scores_of(fit, np.concatenate([fit.T_target_source[None], others]))
    kept: list[int] = []
    for k, T in enumerate(others, start=1):
        if not any(_is_slid(fit, others[j - 1] if j else fit.T_target_source, T) for j in (0, *kept)):
            kept.append(k)
            continue
        # Farther along something may hold the motion: a key in its way.
        deficit, error = scores.deficit(0)
        if -deficit[k] > max(BETTER, SIGNIFICANT * error[k]):
            kept.append(k)
    return np.asarray(others[np.array(kept, dtype=int) - 1])


def but_on_the_way(fit: Fit, others: FloatArray, kernel_scale: float | None) -> FloatArray:
    """Poses, (k, 4, 4), without those from which the loop arrives at the fit: a search refines on a sample alone."""
    kept, last = [], fit
    for T in others[:TRIED]:
        last = last.resumed(T, kernel_scale)
        if last.problem.watch.is_over:
            return others
        kept.append(not last.found or displacement_between(fit, last.T_target_source, fit.T_target_source) > FOUND)
    return np.asarray(others[np.flatnonzero(kept)])


def _is_slid(fit: Fit, T: FloatArray, other: FloatArray) -> bool:
    """Whether a motion that nothing constrains leads from one pose to another.

    Such motions are a group: the logarithm of any of them is a mixture of the free ones, however far it goes.
    """
    information, scale = fit.information, np.r_[[fit.information.lever] * 3, [1.0] * 3]
    free, motion = information.vectors[:, information.free], twist.log(other @ pose.inverse(T))
    along = twist.exp(free @ (free.T @ (scale * motion)) / scale) @ T
    return displacement_between(fit, along, other) <= FOUND


def _copies(fit: Fit) -> FloatArray:
    """The fit's pose after each symmetry of the part, (k, 4, 4): as right as it is."""
    symmetry = fit.problem.target.pairs.symmetry
    if symmetry is None or not fit.found:
        return NO_POSES
    return np.asarray(symmetry.poses[1:] @ fit.T_target_source)


def _without_equal_copies(fits: list[Fit]) -> tuple[list[Fit], FloatArray]:
    """Fits without the symmetric copies of the first that explain the scan no better, and those copies, (k, 4, 4)."""
    found = [fit for fit in fits if fit.found]
    if len(found) < 2 or not fits[0].found:
        return fits, NO_POSES
    poses = np.stack([fit.T_target_source for fit in found])
    is_copy = _is_copy(fits[0], poses)
    is_copy[0] = False
    if not is_copy.any():
        return fits, NO_POSES
    deficit, error = scores_of(found[0], poses).deficit(0)
    is_copy &= -deficit <= np.maximum(BETTER, SIGNIFICANT * error)
    return [fit for fit, drop in zip(found, is_copy, strict=True) if not drop], poses[is_copy]


def _was_near(fit: Fit) -> bool:
    """Whether the initial pose put most of the scan near the target: one somewhere else is a mistake to be told."""
    given = fit.problem.start
    points = fit.prepared.scan.thinned(FEW).points
    placed = points if given is None else pose.apply(fit.problem.to_centred(given), points)
    distances = fit.prepared.surface.closest(placed).distances
    return bool(given is None or np.median(distances) <= fit.problem.reach(fit.prepared))


def _best(fits: list[Fit], start: FloatArray | None) -> Known:
    """The first fit, or another one that nothing speaks against or that explains the scan better."""
    found = [fit for fit in fits if fit.found]
    if not found:
        return Known(fits[0], NO_POSES, searched=True)
    scores = scores_of(found[0], np.stack([fit.T_target_source for fit in found]))
    means = scores.means
    order = np.argsort(-means, kind="stable")
    deficit, error = scores.deficit(int(order[0]))
    worse = scores.distinguishable(int(order[0])) | (deficit > np.minimum(AS_WELL, ERRORS * error + ROUNDING))
    # Among equals the pose that the start leads to goes first, then the one nearest to the start.
    likely = [int(k) for k in order if not worse[k]]
    likely.sort(key=lambda k: (found[k] is not fits[0], _offset(found[k], start)))

    @functools.cache
    def sound(k: int) -> bool:
        # Asked as late as can be: a verdict takes about as long as a registration.
        return is_sound(found[k], ask_mirror=True)

    best = next((k for k in likely if sound(k) and not is_doubtful(found[k], ask_mirror=True)), None)
    if best is None and found[0] is fits[0] and sound(0) and not _is_beside(found[0]):
        # In doubt, but no other pose is free of it: what the verdict refuses displaces nothing.
        best = 0
    if best is None:
        # What the verdict has nothing against goes before what it refuses, where it explains the scan better too: among
        # equals of a scan that lies off the part, the one that happens to pass would be chosen.
        gains = [float(means[k] - means[0]) for k in range(len(found))]
        errors = [float(scores.deficit(k)[1][0]) for k in range(len(found))]
        best = next((k for k in likely if gains[k] > max(BETTER, ERRORS * errors[k]) and sound(k)), None)
    if best is None and is_scene(fits[0]):
        # A face of the part on the table explains more of a scene than the part does; the verdict is not deceived.
        best = next((int(k) for k in order if sound(int(k))), None)
    if best is None:
        best = likely[0]
        gain, sigma = float(means[best] - means[0]), float(scores.deficit(best)[1][0])
        is_better = gain > BETTER and (_offset(found[best], start) <= 1.0 or gain > SIGNIFICANT * sigma)
        best = best if is_better or found[0] is not fits[0] else 0
    apart = scores.distinguishable(best) | (scores.deficit(best)[0] > AS_WELL)
    others = [k for k in range(len(found)) if k != best and not apart[k] and (sound(k) or not sound(best))]
    return Known(found[best], np.array([found[k].T_target_source for k in others]).reshape(-1, 4, 4), searched=True)


def _offset(fit: Fit, start: FloatArray | None) -> float:
    """How far a pose is from the initial one, 1 where that is not meant any more; 0 where none was given."""
    if start is None:
        return 0.0
    T, diagonal = fit.T_target_source, fit.prepared.surface.diagonal
    shift = pose.offset_between(T, start, at=np.zeros(3)) / (MEANT * diagonal)
    return float(max(pose.angle_between(T, start) / MEANT_RAD, shift))
