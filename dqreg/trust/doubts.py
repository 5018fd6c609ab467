"""What speaks against a pose: one function a test; the limits are in `dqreg.trust.limits`."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from dqreg.solvers.search_stage import is_finished
from dqreg.solvers.status import Status
from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import (
    CONSTRAINT_LOG_LIKELIHOOD,
    DISAGREEING_NORMAL_SHARE,
    FREED_GAIN,
    GOING_ON_SHARE,
    MIN_FRACTION_OF_ALL,
    MIN_INLIER_FRACTION,
    MIN_INLIERS,
    MIN_RATIO_TO_EARLIER,
    MIRROR_GAIN,
    OFF_FACE_SHARE,
    chance_limit,
    counts_all,
    fewest_carriers,
    has_large_residuals,
    most_clutter,
    most_patches_off,
    noise_of_parts,
    outlier_share,
    sigma_limits,
)
from dqreg.trust.records import Code
from dqreg.trust.shape_doubts import (
    bent,
    closed_hole,
    deformed,
    drift,
    ends_apart,
    faces_apart,
    looked_through,
    one_plane,
    opposed_edges,
    rims_apart,
    rims_elsewhere,
    stretched,
    wavy,
)

# What to do about a loop that ended so.
ADVICE: dict[Status, str] = {
    "iteration limit": "; raise max_iterations, or give a closer initial pose",
    "stalled": "; the step size stopped decreasing: check the pose, or give a closer initial pose",
}


def counted(evidence: Evidence) -> str:
    """The points that the fraction of inliers is of."""
    return "the points" if counts_all(evidence) else f"the points within {evidence.length(evidence.near)} of the target"


# One function a test: it yields a sentence where the evidence is against the pose. A number that is NaN must not pass.


def _few_inliers(evidence: Evidence) -> Iterator[str]:
    if not evidence.inliers >= MIN_INLIERS:
        yield f"only {evidence.inliers:.0f} inliers: too few to check the pose"
    elif not evidence.places >= MIN_INLIERS:
        yield f"the inliers lie at {evidence.places:.0f} distinct places only: too few to check the pose"


def _low_inlier_fraction(evidence: Evidence) -> Iterator[str]:
    if not evidence.share_near >= (MIN_FRACTION_OF_ALL if counts_all(evidence) else MIN_INLIER_FRACTION):
        if counts_all(evidence):
            cause = "the pose may have slipped"
        else:
            cause = "a local minimum, another part, or much clutter"
        yield (
            f"only {100 * evidence.share_near:.0f} % of {counted(evidence)} are inliers (residuals of "
            f"{evidence.length(evidence.width)}, one sigma): {cause}"
        )


def fraction_fits(fraction: float, usual: float) -> bool:
    """Whether neither test of the fraction of inliers speaks against a frame.

    >>> fraction_fits(0.6, 0.7), fraction_fits(0.6, 0.9), fraction_fits(0.4, float("nan"))
    (True, False, False)
    """
    return fraction >= MIN_FRACTION_OF_ALL and not fraction < MIN_RATIO_TO_EARLIER * usual


def _falling_inlier_fraction(evidence: Evidence) -> Iterator[str]:
    if evidence.share_near < MIN_RATIO_TO_EARLIER * evidence.usual:
        yield (
            f"{100 * evidence.share_near:.0f} % of {counted(evidence)} are inliers, after "
            f"{100 * evidence.usual:.0f} % in the frames before: the pose may have slipped, or the view is new"
        )


def _forbidden_motion(evidence: Evidence) -> Iterator[str]:
    if evidence.freed_gain > FREED_GAIN:
        yield (
            f"the scan fits better after a rotation by {math.degrees(evidence.freed_rad):.2g} degrees and a shift by "
            f"{evidence.length(evidence.freed_shift)} of the middle, which dof= or prior= forbids"
        )


def _mirrored(evidence: Evidence) -> Iterator[str]:
    # A pose that is held away from its own may gain as much in the mirror.
    if evidence.mirror_gain > MIRROR_GAIN and not evidence.freed_gain >= evidence.mirror_gain:
        # At a wrong scale neither image fits, and either may gain.
        scaled = evidence.stretch and not any(evidence.stretched_along)
        also = "; at another scale this may be otherwise" if scaled else ""
        yield (
            "the scan fits better when mirrored: it shows the part's mirror image, or comes from a left-handed frame"
            + also
        )


def _deviating_patches(evidence: Evidence) -> Iterator[str]:
    off = evidence.patches_off - evidence.patches_deformed
    if not off <= most_patches_off(evidence):
        yield (
            f"{100 * off:.0f} % of the patches of points within {evidence.length(evidence.near)} of "
            "the target deviate as a whole: a local minimum, another part, or an object that touches the part"
        )


def _contradicting_surface(evidence: Evidence) -> Iterator[str]:
    if evidence.contradiction > OFF_FACE_SHARE:
        yield (
            f"{100 * evidence.share_contradicting:.0f} % of the scan are faces that continue beyond the target or meet "
            f"it in a convex edge, and {100 * evidence.share_on:.0f} % are on it: another part, or a wrong pose"
        )
    elif evidence.going_on > GOING_ON_SHARE:
        yield (
            f"beside {100 * evidence.going_on:.0f} % of the points on the target the scan goes on beyond it in their "
            f"plane, and {100 * evidence.share_on:.2g} % of the scan are on it: a corner of something larger; check "
            "the units, or cut the scan to the part"
        )


def _clutter(evidence: Evidence) -> Iterator[str]:
    limit, is_alone = most_clutter(evidence), evidence.clutter == "none"
    share_on = evidence.share_on + evidence.share_deformed
    if not (share_on >= 1.0 - limit or math.isnan(limit)):
        why = 'it is said to show alone (clutter="none")' if is_alone else "is no smaller than the scan"
        off = f"{100 * (1.0 - share_on):.0f} % of the scan are off the target"
        yield f"{off}, which {why}: a wrong pose, another part, or other objects"


def _disagreeing_normals(evidence: Evidence) -> Iterator[str]:
    if not evidence.normals_apart <= DISAGREEING_NORMAL_SHARE:
        yield (
            f"{100 * evidence.normals_apart:.0f} % of the inliers have normals that disagree with the target: a local "
            "minimum, another part, or normals that were given without a side"
        )


def _outliers(evidence: Evidence) -> Iterator[str]:
    share, limit = outlier_share(evidence)
    if not share <= limit:
        yield (
            f"{100 * share:.0f} % of all points are outliers amid no smooth surface, and only "
            f"{evidence.inliers:.0f} are inliers: clean the scan, or check the pose"
        )


def _large_residuals(evidence: Evidence) -> Iterator[str]:
    if has_large_residuals(evidence):
        noise = noise_of_parts(evidence)
        yield (
            f"the residuals are {evidence.length(evidence.width)} (one sigma), "
            f"{evidence.width / noise:.0f} times the scan's own noise "
            f"({evidence.length(noise)}): the shapes differ, or the pose is wrong"
        )


def _local_difference(evidence: Evidence) -> Iterator[str]:
    if evidence.is_detail and evidence.share_together:
        yield (
            f"the scan shows a detail of the target, and {100 * evidence.share_together:.2g} % of it lie beside each "
            "other off the target: it may fit better elsewhere; scan more of the part"
        )


def _random_fit(evidence: Evidence) -> Iterator[str]:
    if not evidence.random_ratio <= chance_limit(evidence):
        yield (
            f"the residuals are {100 * evidence.random_ratio:.0f} % of those at random poses: the scan does not show "
            "the shape of the target"
        )


def _unconstrained(evidence: Evidence) -> Iterator[str]:
    return (direction.words for direction in evidence.directions if direction.is_free)


def _large_uncertainty(evidence: Evidence) -> Iterator[str]:
    limits = sigma_limits(evidence.size)
    for direction in evidence.directions:
        if direction.kind in limits and direction.sigma > limits[direction.kind]:
            yield (
                f"the pose is uncertain by {evidence.length(direction.sigma)} (one sigma, "
                f"{100 * direction.sigma / evidence.size:.0f} % of the size): {direction.words}"
            )


def _weakly_constrained(evidence: Evidence) -> Iterator[str]:
    if evidence.sliding_loss >= CONSTRAINT_LOG_LIKELIHOOD:
        return
    fewest = fewest_carriers(evidence.inliers, of_both=evidence.carriers_of_both)
    for direction, carriers in zip(evidence.directions, evidence.carriers, strict=False):
        if not direction.is_free and carriers < fewest:
            held = f"about {carriers:.0f} points" + (" on which both scans agree" if evidence.carriers_of_both else "")
            yield f"one motion depends on {held}: {direction.words}"


def _alternative_poses(evidence: Evidence) -> Iterator[str]:
    others = [alternative for alternative in evidence.alternatives if not alternative._is_symmetric]
    if others:
        some = "another pose is" if len(others) == 1 else f"{len(others)} other poses are"
        where = f"; the scan fits as well {others[0].words}" if others[0].words else ""
        remedy = "; with prediction=, or stamp= and no long gap, the motion decides" if counts_all(evidence) else ""
        yield f"{some} equally likely: see alternatives{where}{remedy}"


def _search_time_limit(evidence: Evidence) -> Iterator[str]:
    if not is_finished(evidence.search):
        yield (
            f'the time limit ended the global search after its stage "{evidence.search}": its poses were not compared; '
            "allow more time, or give an initial pose"
        )


def _not_converged(evidence: Evidence) -> Iterator[str]:
    if evidence.status != "converged":
        advice = "" if counts_all(evidence) else ADVICE.get(evidence.status, "")
        yield f"ICP did not converge: {evidence.status}{advice}"


# In the order in which a verdict names them.
DOUBTS: tuple[tuple[Code, Callable[[Evidence], Iterator[str]]], ...] = (
    ("few_inliers", _few_inliers),
    ("low_inlier_fraction", _low_inlier_fraction),
    ("falling_inlier_fraction", _falling_inlier_fraction),
    # Before what the shape seems to be at a pose that is held where the scan does not fit.
    ("forbidden_motion", _forbidden_motion),
    # Before the mirror image: a part that shrank feigns one.
    ("stretched", stretched),
    ("mirrored", _mirrored),
    ("deviating_patches", _deviating_patches),
    ("contradicting_surface", _contradicting_surface),
    ("clutter", _clutter),
    ("looked_through", looked_through),
    ("faces_apart", faces_apart),
    ("ends_apart", ends_apart),
    ("rims_apart", rims_apart),
    ("rims_elsewhere", rims_elsewhere),
    ("opposed_edges", opposed_edges),
    ("closed_hole", closed_hole),
    ("one_plane", one_plane),
    ("disagreeing_normals", _disagreeing_normals),
    ("outliers", _outliers),
    ("large_residuals", _large_residuals),
    ("local_difference", _local_difference),
    ("wavy", wavy),
    ("bent", bent),
    ("deformed", deformed),
    ("drift", drift),
    ("random_fit", _random_fit),
    ("unconstrained", _unconstrained),
    ("large_uncertainty", _large_uncertainty),
    ("weakly_constrained", _weakly_constrained),
    ("alternative_poses", _alternative_poses),
    ("search_time_limit", _search_time_limit),
    ("not_converged", _not_converged),
)
