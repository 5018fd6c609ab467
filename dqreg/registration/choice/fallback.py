"""The second try: where a pose is in doubt, others are searched for, asked the same questions, and the best is kept."""

from __future__ import annotations

import dataclasses
import functools

import numpy as np

from dqreg._arrays import FloatArray
from dqreg._statuses import INTERRUPTED
from dqreg.registration.assessment.assess import evidence_of, is_partial, uncertainty_of, verdict_on
from dqreg.registration.evidence.local_evidence import MISFIT
from dqreg.registration.fit.displacement import FEW, displacement_between, offset_from_start
from dqreg.registration.fit.fit import Fit
from dqreg.registration.initial_pose import GlobalSearch, InitialPose
from dqreg.registration.other_poses.near_places import near_maps
from dqreg.registration.other_poses.rivals import (
    MIN_GAIN_SIGMAS,
    MIN_LOG_GAIN,
    NO_POSES,
    down_to_noise,
    mirror_gain,
    scores_of,
)
from dqreg.registration.other_poses.same_poses import (
    TRIED,
    but_on_the_way,
    but_slid,
    copies_of,
    exact_symmetries,
    is_copy_of,
    without_equal_copies,
)
from dqreg.registration.other_poses.slides import without_slide
from dqreg.registration.overlap.free_space import looked_through_at
from dqreg.registration.problem.derived_values import Key
from dqreg.rigid import pose
from dqreg.search.scoring import EQUAL_LOG_LIKELIHOOD
from dqreg.trust.code_sets import REASONS_OF_SCAN, REASONS_OF_SCAN_BETWEEN_CLOUDS, TOO_LITTLE
from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import RIM_GAIN_SHARE, own_noise
from dqreg.trust.records import Verdict

# Fraction of the points near a part that lie off it beyond which the same is done: right poses leave 0.002, and half
# of the strays. Fewer than the verdict allows are evidence where they are no strays.
DOUBTFUL_OFF_SHARE, DOUBTFUL_OFF_PER_OUTLIER = 0.015, 0.7
# The same of points that lie off it beside each other: outliers do not, and right poses leave none.
DOUBTFUL_TOGETHER_SHARE = 5e-3
# Fraction of all points off the target, of a scan that is no scene with the part in it, from which on the same is done.
DOUBTFUL_OFF_TARGET_SHARE = 0.15
# Poses within so much of the best mean log-likelihood explain the scan about as well; within so many standard errors,
# and what is left of refinements that have not quite ended, they are as likely as the best: how much says `scoring`.
EQUAL_SIGMAS = 3.0
REFINEMENT_ROUNDING = 5e-4
# Displacement of a point from the initial pose, in sizes, beyond which the loop between two clouds is in no basin that
# was meant; a rotation by 23 degrees, or less with a shift.
DOUBTFUL_DISPLACEMENT_DIAGONALS = 0.2
# Points of two clouds near each other, and within their borders, of which so large a share lies apart: right poses of
# one body leave 0.002.
DOUBTFUL_APART_SHARE_OF_CLOUDS = 0.02
# Share of a slide that rims name by which another pose may be nearer or farther: slides are tried in steps.
SLIDE_ROUNDING = 0.25
# By whether the mirror image is asked in any case.
DOUBTFUL: dict[bool, Key[bool]] = {False: Key(), True: Key()}


@dataclasses.dataclass(frozen=True)
class BestPoses:
    """The best of the poses that are known."""

    fit: Fit
    others: FloatArray  # (k, 4, 4): Others that explain the scan about as well, between the centred frames
    searched: bool = False  # Whether it was compared with the poses of a global search
    start_lost: bool = False  # Whether the initial pose that was given led nowhere
    turned: FloatArray = dataclasses.field(default_factory=lambda: NO_POSES)  # (k, 4, 4): Turns of a ring as likely


def best_known(fit: Fit, start: InitialPose, search: GlobalSearch) -> BestPoses:
    """The best of a fit and, where that is in doubt, of what a global search finds."""
    problem, is_given = fit.problem, fit.problem.start is not None
    known = BestPoses(fit, start.others)
    if problem.watch.is_over or fit.run.status in INTERRUPTED or not start.is_judged:
        return known
    if is_given and not may_search(fit):
        return known
    is_asked = is_given and (problem.options.search == "always" or is_partial(fit) or _is_astray(fit, start))
    beside = np.concatenate([start.others, start.unlikely])
    if not is_asked and ((not is_given and not len(beside)) or not is_doubtful(fit)):
        return BestPoses(fit, but_on_the_way(fit, start.others, search.kernel_scale))
    if is_given:
        found = search.candidates(_compared(fit))
        others = np.array([c.T_target_source for c in found]).reshape(-1, 4, 4)
    else:
        others = beside
    others = but_slid(fit, others)
    is_copy = is_copy_of(fit, others)
    fits, last = [fit], fit
    # A part that is nearly symmetric has copies that are wrong: the points decide, after the other poses.
    for T in others[np.argsort(is_copy, kind="stable")][:TRIED]:
        last = last.resumed(T, search.kernel_scale)
        if last.problem.watch.is_over:
            break
        # What stands beside the part may hold the kernel wide here too.
        fits.append(without_slide(down_to_noise(last))[0])
    fits, copies = without_equal_copies(fits)
    known = _best(fits, start.T_target_source if is_given else None)
    if is_partial(fit):
        copies = np.concatenate([copies, copies_of(known.fit)])
    return dataclasses.replace(known, others=np.concatenate([known.others, copies]))


def _compared(fit: Fit) -> FloatArray | None:
    """The pose of a fit on a part that nothing speaks against, and those that its symmetries lead to, (k, 4, 4).

    What few planes show may fit elsewhere; near symmetries of the pose were asked all that the search would ask.
    """
    if fit.problem.options.search == "always" or fit.between_clouds:
        return None
    if fit.problem.options.method != "auto" or fit.is_scene or is_doubtful(fit, ask_mirror=True):
        return None
    maps = np.concatenate([np.eye(4)[None], near_maps(fit)])
    return np.asarray((exact_symmetries(fit)[:, None] @ maps @ fit.T_target_source).reshape(-1, 4, 4))


def _is_astray(fit: Fit, start: InitialPose) -> bool:
    """Whether a pose between two clouds is one that the initial pose did not mean, or leaves some of both apart.

    Two clouds fit at many poses, with less in common: what lies off the target may be what it does not show. Where the
    place of a scanner is known, its free space tells.
    """
    if not fit.between_clouds or not fit.found or np.isfinite(looked_through_at(fit)[0]):
        return False
    return (
        fit.agreement.share_near < 1.0 - DOUBTFUL_APART_SHARE_OF_CLOUDS
        or displacement_between(fit, start.T_target_source, fit.T_target_source) > DOUBTFUL_DISPLACEMENT_DIAGONALS
    )


def may_search(fit: Fit) -> bool:
    """Whether a global search beside the initial pose is allowed; what was asked for in so many words is done alone."""
    options = fit.problem.options
    return options.search == "always" or (options.search == "doubt" and fit.may_be_moved)


def is_doubtful(fit: Fit, *, ask_mirror: bool = False) -> bool:
    """Whether something speaks against a pose that another one might mend."""
    return fit.derived.once(DOUBTFUL[ask_mirror], lambda: _is_doubtful(fit, ask_mirror))


def _is_doubtful(fit: Fit, ask_mirror: bool) -> bool:
    if not fit.found:
        return _may_be_elsewhere(fit)
    # Two scans of one scene always differ somewhere, and the noise between them is not known as well.
    if not fit.has_border and _is_off_or_rough(fit.agreement):
        return True
    return _is_beside(fit) or not is_sound(fit, ask_mirror=ask_mirror)


def _is_off_or_rough(found: Evidence) -> bool:
    """Whether some of a scan lies off its part, or it lies there by more than its noise."""
    is_off = found.share_near < 1.0 - DOUBTFUL_OFF_SHARE - DOUBTFUL_OFF_PER_OUTLIER * found.strays
    is_off |= found.share_together > DOUBTFUL_TOGETHER_SHARE
    return is_off or found.width > MISFIT * own_noise(found) > 0.0


def _is_beside(fit: Fit) -> bool:
    """Whether much of a scan no larger than a closed target lies off it: a part upside down leaves its hub so."""
    return not fit.has_border and fit.agreement.share_on < 1.0 - DOUBTFUL_OFF_TARGET_SHARE and not fit.is_scene


def is_sound(fit: Fit, *, ask_mirror: bool = False) -> bool:
    """Whether the verdict has nothing against a pose that another one might mend."""
    verdict = _verdict_beside_mirror(fit, ask_mirror)
    of_scan = REASONS_OF_SCAN_BETWEEN_CLOUDS if fit.between_clouds else REASONS_OF_SCAN
    return verdict.level == "accepted" or of_scan.issuperset(verdict.codes)


def _verdict_beside_mirror(fit: Fit, ask_mirror: bool) -> Verdict:
    gain = mirror_gain(fit, always=ask_mirror)
    return verdict_on(fit, evidence_of(fit, uncertainty_of(fit), mirror_gain=gain))


def _is_hardly_held(fit: Fit) -> bool:
    """Whether too little speaks for a pose on a part, and nothing against it: it may be the right one all the same."""
    return not fit.between_clouds and TOO_LITTLE.issuperset(_verdict_beside_mirror(fit, ask_mirror=True).codes)


def _may_be_elsewhere(fit: Fit) -> bool:
    """Whether a scan that an initial pose leads nowhere may lie elsewhere: on a part, or near where it was put.

    A scan is of its part. Two clouds may have nothing in common, and one that was put beside the other says so.
    """
    given = fit.problem.start
    if given is None or not fit.between_clouds:
        return True
    placed = pose.apply(fit.problem.to_centred(given), fit.prepared.scan.thinned(FEW).points)
    distances = fit.prepared.surface.closest(placed).distances
    return bool(np.median(distances) <= fit.problem.reach(fit.prepared))


def _best(fits: list[Fit], start: FloatArray | None) -> BestPoses:
    """The first fit, or another one that nothing speaks against or that explains the scan better."""
    found = [fit for fit in fits if fit.found]
    if not found:
        return BestPoses(fits[0], NO_POSES, searched=True)
    candidates = _Candidates(found, start, has_first=found[0] is fits[0])
    best = candidates.best()
    others = np.array([found[k].T_target_source for k in candidates.equals_of(best)]).reshape(-1, 4, 4)
    return BestPoses(found[best], others, searched=True)


class _Candidates:
    """Fits of one scan, of which one is the answer; the first may be that to which the start leads."""

    def __init__(self, fits: list[Fit], start: FloatArray | None, *, has_first: bool) -> None:
        self._fits, self._has_first = fits, has_first
        self._scores = scores_of(fits[0], np.stack([fit.T_target_source for fit in fits]))
        self._offsets = [offset_from_start(fit, fit.T_target_source, start) for fit in fits]
        # The most likely one first.
        self._order = [int(k) for k in np.argsort(-self._scores.means, kind="stable")]
        deficit, error = self._scores.deficit(self._order[0])
        as_likely = np.minimum(EQUAL_LOG_LIKELIHOOD, EQUAL_SIGMAS * error + REFINEMENT_ROUNDING)
        worse = self._scores.distinguishable(self._order[0]) | (deficit > as_likely)
        # Among equals that to which the start leads goes first, then the one nearest to the start.
        self._likely = [k for k in self._order if not worse[k]]
        self._likely.sort(key=lambda k: (not has_first or k > 0, self._offsets[k]))
        # Asked as late as can be: a verdict takes about as long as a registration.
        self._is_sound = functools.cache(lambda k: is_sound(fits[k], ask_mirror=True))

    def best(self) -> int:
        """The answer: what the first rule that finds one says."""
        by_points = self._undoubted, self._sound_first, self._sound_and_better
        for rule in (*by_points, self._sound_in_scene, self._sound_after_slide):
            if (best := rule()) is not None:
                return best
        return self._likeliest()

    def equals_of(self, best: int) -> list[int]:
        """Others that explain the scan about as well; where the best passes, without what something speaks against."""
        apart = self._scores.distinguishable(best) | (self._scores.deficit(best)[0] > EQUAL_LOG_LIKELIHOOD)
        others = [k for k in range(len(self._fits)) if k != best and not apart[k]]
        return [k for k in others if self._is_sound(k) or not self._is_sound(best) or _is_hardly_held(self._fits[k])]

    def _undoubted(self) -> int | None:
        best = next((k for k in self._likely if self._is_sound(k) and not self._is_doubtful(k)), None)
        # On a part a start that passes is left for what is significantly better alone.
        if best and self._has_first and not self._fits[0].between_clouds and self._is_kept():
            return best if self._gains(best, MIN_GAIN_SIGMAS) or self._scores.distinguishable(best)[0] else 0
        # How much two clouds have in common differs from place to place: where nothing speaks against either pose, the
        # one that the start leads to is meant.
        if best and self._has_first and self._fits[0].between_clouds and not self._is_doubtful(0):
            return best if self._gains(best, MIN_GAIN_SIGMAS) else 0
        return best

    def _is_kept(self) -> bool:
        return self._is_sound(0) and not _is_beside(self._fits[0])

    def _sound_first(self) -> int | None:
        # In doubt, but no other pose is free of it: what the verdict refuses displaces nothing.
        return 0 if self._has_first and self._is_kept() else None

    def _sound_and_better(self) -> int | None:
        # Among equals of a scan that lies off the part, the one that happens to pass would be chosen.
        return next((k for k in self._likely if self._gains(k, EQUAL_SIGMAS) and self._is_sound(k)), None)

    def _sound_in_scene(self) -> int | None:
        # A face of the part on the table explains more of a scene than the part does; the verdict is not deceived.
        return next((k for k in self._order if self._is_sound(k)), None) if self._fits[0].is_scene else None

    def _sound_after_slide(self) -> int | None:
        # Both sides of a wall laid on each other have more in common than there is; the rims beside them tell how far
        # the right pose is, at which nothing may be left to say.
        fit = self._fits[self._likeliest()]
        gained, slide = evidence_of(fit, uncertainty_of(fit)).rims_elsewhere
        if not gained > RIM_GAIN_SHARE:
            return None
        far = slide / fit.prepared.surface.diagonal
        gaps = (displacement_between(fit, fit.T_target_source, other.T_target_source) for other in self._fits)
        there = [abs(gap - far) <= SLIDE_ROUNDING * far for gap in gaps]
        return next((k for k in self._order if there[k] and self._is_sound(k)), None)

    def _likeliest(self) -> int:
        best = self._likely[0]
        # A rough initial pose is meant all the same: a pose far from it has to be significantly better.
        is_better = self._gains(best, 0.0 if self._offsets[best] <= 1.0 else MIN_GAIN_SIGMAS)
        return best if is_better or not self._has_first else 0

    def _is_doubtful(self, k: int) -> bool:
        return is_doubtful(self._fits[k], ask_mirror=True)

    def _gains(self, k: int, sigmas: float) -> bool:
        """Whether one explains the scan better than the first, by so many standard errors at least."""
        gain = float(self._scores.means[k] - self._scores.means[0])
        return gain > max(MIN_LOG_GAIN, sigmas * float(self._scores.deficit(k)[1][0]))
