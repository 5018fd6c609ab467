"""What speaks against a pose: one function a test, and its limit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from dqreg.solvers.motion_words import direction_words
from dqreg.solvers.status import Status
from dqreg.trust.evidence import Evidence
from dqreg.trust.records import Code

# Inliers below this fraction of the points near the target: a local minimum, another part, or much clutter.
FEW_INLIERS = 0.7
# The same where all points count (odometry), and against the frames before.
FEW_OF_ALL, FALL = 0.5, 0.75
# Fewer inliers determine a pose of six unknowns with nothing left to check it.
FEWEST_INLIERS = 30
# Fewer fix no pose at all.
FEWEST_OF_ALL = 3
# Patches of neighbouring points that deviate as a whole; inliers with another normal; points that lie on no surface:
# fractions above these speak against the pose.
PATCHES_OFF, NORMALS_APART, STRAYS = 0.03, 0.15, 0.5
# Two scans of one scene see different sides of things, and things move.
PATCHES_OFF_BORDER = 0.12
# Outliers take some patches along: so many more may deviate for each of them.
OFF_PER_STRAY = 0.25
# Residuals this many times the scan's own noise: the shapes differ, or the pose is wrong.
ROUGH = 5.0
# Mean log-likelihood that mirroring the scan may gain: good scans lose 0.25 and more, mirrored ones gain as much.
MIRRORED = 0.015
# Residuals over those at random poses: scans come to 0.09 at most, noise that was accepted to 0.4 and more.
CHANCE = 0.25
# Share of the scan on a closed part below which that ratio is to be less, in proportion.
MOSTLY_ON = 0.5
# Standard deviations of the pose beyond these are no answer: rotations, and translations in sizes of the target.
UNCERTAIN_RAD, UNCERTAIN = math.radians(2.0), 0.02
# A motion constrained by fewer points than this, and by this fraction of the inliers, depends on a detail or outliers.
DETAIL, DETAIL_SHARE = 30.0, 0.02
# The same where those of two scans are counted on which the normals of both agree, whatever the number of inliers:
# chance alone reaches 10 of them.
DETAIL_OF_BOTH = 20.0
# But not where displacements along it cost the whole scan so much log-likelihood: chance reaches it once in 10^8.
HOLDS = 20.0
# Surface of the part itself off the target, in shares of what is on it; points off a part that is said to be alone.
CONTRADICTING, CLUTTER = 0.08, 0.05
# Points where a scanner looked through: right poses of depth cameras and LiDARs came to 0.004, wrong ones to 0.05.
LOOKED_THROUGH = 0.05
# Places of two scans that lie apart: right poses of measured pairs came to 0.025, most ripples of 0.4 % to 0.07.
FACES_APART = 0.03
# Faces beyond those of the other scan, where both have three planes in common at most: right poses of generated views
# came to 0.02, one in 42 to 0.1; other parts to 0.05 and more.
ENDS_APART = 0.04
# What to do about a loop that ended so.
ADVICE: dict[Status, str] = {
    "iteration limit": "; raise max_iterations, or give a closer initial pose",
    "stalled": "; the step size stopped decreasing: check the pose, or give a closer initial pose",
}


def fewest_carriers(inliers: float, *, of_both: bool = False) -> float:
    """Fewer points that constrain a motion may be a detail or outliers; of both: those on which two scans agree."""
    return DETAIL_OF_BOTH if of_both else min(DETAIL, DETAIL_SHARE * inliers)


def counts_all(evidence: Evidence) -> bool:
    """Whether all points count, as of a frame of a sequence."""
    return math.isinf(evidence.near)


def counted(evidence: Evidence) -> str:
    """The points that the fraction of inliers is of."""
    return "the points" if counts_all(evidence) else f"the points within {evidence.length(evidence.near)} of the target"


# One function a test: it yields a sentence where the evidence is against the pose. Conditions are written as "not
# enough" instead of "too little", because a number that is NaN must not pass.


def _few_inliers(evidence: Evidence) -> Iterator[str]:
    if not evidence.inliers >= FEWEST_INLIERS:
        yield f"only {evidence.inliers:.0f} inliers: too few to check the pose"


def _low_inlier_fraction(evidence: Evidence) -> Iterator[str]:
    if not evidence.share_near >= (FEW_OF_ALL if counts_all(evidence) else FEW_INLIERS):
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

    >>> fraction_fits(0.6, 0.7), fraction_fits(0.6, 0.9), fraction_fits(0.4, math.nan)
    (True, False, False)
    """
    return fraction >= FEW_OF_ALL and not fraction < FALL * usual


def _falling_inlier_fraction(evidence: Evidence) -> Iterator[str]:
    if evidence.share_near < FALL * evidence.usual:
        yield (
            f"{100 * evidence.share_near:.0f} % of {counted(evidence)} are inliers, after "
            f"{100 * evidence.usual:.0f} % in the frames before: the pose may have slipped, or the view is new"
        )


def _mirrored(evidence: Evidence) -> Iterator[str]:
    if evidence.mirror_gain > MIRRORED:
        # At a wrong scale neither image fits, and either may gain.
        scaled = evidence.stretch and not any(evidence.stretched_along)
        also = "; at another scale this may be otherwise" if scaled else ""
        yield (
            "the scan fits better when mirrored: it shows the part's mirror image, or comes from a left-handed frame"
            + also
        )


def _deviating_patches(evidence: Evidence) -> Iterator[str]:
    allowed = PATCHES_OFF_BORDER if evidence.has_border else PATCHES_OFF
    if not evidence.patches_off <= allowed + OFF_PER_STRAY * evidence.strays:
        yield (
            f"{100 * evidence.patches_off:.0f} % of the patches of points within {evidence.length(evidence.near)} of "
            "the target deviate as a whole: a local minimum, another part, or an object that touches the part"
        )


def _contradicting_surface(evidence: Evidence) -> Iterator[str]:
    if not evidence.share_contradicting <= CONTRADICTING * (evidence.share_on + evidence.share_contradicting):
        yield (
            f"{100 * evidence.share_contradicting:.0f} % of the scan are faces that continue beyond the target or meet "
            f"it in a convex edge, and {100 * evidence.share_on:.0f} % are on it: another part, or a wrong pose"
        )


def _clutter(evidence: Evidence) -> Iterator[str]:
    if evidence.clutter == "none" and not evidence.share_on >= 1.0 - CLUTTER:
        yield (
            f"{100 * (1.0 - evidence.share_on):.0f} % of the scan are off the target, which it is said to show alone "
            '(clutter="none"): a wrong pose, another part, or other objects'
        )


def _looked_through(evidence: Evidence) -> Iterator[str]:
    if evidence.looked_through > LOOKED_THROUGH:
        yield (
            f"{100 * evidence.looked_through:.0f} % of the points compared stand where a scanner looked through: a "
            "wrong pose, or things that moved between the scans"
        )


def _faces_apart(evidence: Evidence) -> Iterator[str]:
    if evidence.faces_apart > FACES_APART:
        yield (
            f"{100 * evidence.faces_apart:.0f} % of the places that both scans show lie apart by more than their noise "
            "and 0.2 % of the size: a wrong pose, or things that moved or differ between the scans"
        )


def _ends_apart(evidence: Evidence) -> Iterator[str]:
    if evidence.ends_apart > ENDS_APART:
        yield (
            "the scans have three planes in common at most, which fit many corners, and their faces end at different "
            f"places: {100 * evidence.ends_apart:.0f} % of each and more lie beyond the other's"
        )


def _disagreeing_normals(evidence: Evidence) -> Iterator[str]:
    if not evidence.normals_apart <= NORMALS_APART:
        yield (
            f"{100 * evidence.normals_apart:.0f} % of the inliers have normals that disagree with the target: a local "
            "minimum or another part"
        )


def _outliers(evidence: Evidence) -> Iterator[str]:
    if not evidence.strays <= STRAYS:
        yield (
            f"{100 * evidence.strays:.0f} % of all points are outliers amid no smooth surface, and only "
            f"{evidence.inliers:.0f} are inliers: clean the scan, or check the pose"
        )


def _large_residuals(evidence: Evidence) -> Iterator[str]:
    if evidence.expected > 0.0 and not evidence.width <= ROUGH * evidence.expected:
        yield (
            f"the residuals are {evidence.length(evidence.width)} (one sigma), "
            f"{evidence.width / evidence.expected:.0f} times the scan's own noise "
            f"({evidence.length(evidence.expected)}): the shapes differ, or the pose is wrong"
        )


def _stretched(evidence: Evidence) -> Iterator[str]:
    if not evidence.stretch:
        return
    along = evidence.stretched_along if any(evidence.stretched_along) else None
    how = ("short", "long")[evidence.stretch > 0.0] if along else ("small", "large")[evidence.stretch > 0.0]
    words = f"{100 * abs(evidence.stretch):.2g} % too {how}" + (f" along {direction_words(along)}" if along else "")
    cause = (
        "another part" if along else 'a part that shrank or a scaled file (scale="solve" estimates it), another part'
    )
    yield f"the scan is {words}: {cause}, or a local minimum"


def _bent(evidence: Evidence) -> Iterator[str]:
    if evidence.bend:
        yield f"the scan is bent or twisted by {100 * evidence.bend:.2g} % of its length against the target"


def _drift(evidence: Evidence) -> Iterator[str]:
    if evidence.drift:
        along = f" along {direction_words(evidence.drift_along)}" if any(evidence.drift_along) else ""
        yield (
            f"the pose drifts by {evidence.length(evidence.drift)}{along} and "
            f"{math.degrees(evidence.drift_rad):.2g} degrees within the scan: part or scanner moved during it or "
            "between two exposures, or its views do not fit"
        )


def chance_limit(evidence: Evidence) -> float:
    """Largest random ratio: where a pose leaves most of a scan off a closed part, it was chosen for the rest alone."""
    return CHANCE * (1.0 if evidence.has_border else min(1.0, evidence.share_on / MOSTLY_ON))


def _random_fit(evidence: Evidence) -> Iterator[str]:
    if not evidence.random_ratio <= chance_limit(evidence):
        yield (
            f"the residuals are {100 * evidence.random_ratio:.0f} % of those at random poses: the scan does not show "
            "the shape of the target"
        )


def _unconstrained(evidence: Evidence) -> Iterator[str]:
    return (direction.words for direction in evidence.directions if direction.is_free)


def _large_uncertainty(evidence: Evidence) -> Iterator[str]:
    # A rotation by its displacement at half the diagonal.
    limits = {"rotation": 0.5 * UNCERTAIN_RAD * evidence.size, "translation": UNCERTAIN * evidence.size}
    for direction in evidence.directions:
        if direction.kind in limits and direction.sigma > limits[direction.kind]:
            yield (
                f"the pose is uncertain by {evidence.length(direction.sigma)} (one sigma, "
                f"{100 * direction.sigma / evidence.size:.0f} % of the size): {direction.words}"
            )


def _weakly_constrained(evidence: Evidence) -> Iterator[str]:
    if evidence.sliding_loss >= HOLDS:
        return
    fewest = fewest_carriers(evidence.inliers, of_both=evidence.carriers_of_both)
    for direction, carriers in zip(evidence.directions, evidence.carriers, strict=False):
        if not direction.is_free and carriers < fewest:
            held = f"about {carriers:.0f} points" + (" on which both scans agree" if evidence.carriers_of_both else "")
            yield f"one motion depends on {held}: {direction.words}"


def _alternative_poses(evidence: Evidence) -> Iterator[str]:
    others = [alternative for alternative in evidence.alternatives if not alternative.symmetry]
    if others:
        some = "another pose is" if len(others) == 1 else f"{len(others)} other poses are"
        where = f"; the scan fits as well {others[0].words}" if others[0].words else ""
        yield f"{some} equally likely: see alternatives{where}"


def _search_time_limit(evidence: Evidence) -> Iterator[str]:
    if evidence.search not in ("", "judged"):
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
    # Before the mirror image: a part that shrank feigns one.
    ("stretched", _stretched),
    ("mirrored", _mirrored),
    ("deviating_patches", _deviating_patches),
    ("contradicting_surface", _contradicting_surface),
    ("clutter", _clutter),
    ("looked_through", _looked_through),
    ("faces_apart", _faces_apart),
    ("ends_apart", _ends_apart),
    ("disagreeing_normals", _disagreeing_normals),
    ("outliers", _outliers),
    ("large_residuals", _large_residuals),
    ("bent", _bent),
    ("drift", _drift),
    ("random_fit", _random_fit),
    ("unconstrained", _unconstrained),
    ("large_uncertainty", _large_uncertainty),
    ("weakly_constrained", _weakly_constrained),
    ("alternative_poses", _alternative_poses),
    ("search_time_limit", _search_time_limit),
    ("not_converged", _not_converged),
)
