"""Questions of the verdict on how the scan fits: its inliers, residuals, and what of it is off the target."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import (
    CLUTTER_SHARE,
    DISAGREEING_NORMAL_SHARE,
    GOING_ON_SHARE,
    MIN_FRACTION_OF_ALL,
    MIN_INLIER_FRACTION,
    MIN_INLIERS,
    MIN_RATIO_TO_EARLIER,
    OFF_FACE_SHARE,
    RESIDUAL_NOISE_RATIO,
    chance_limit,
    counts_all,
    looked_through_limit,
    most_clutter,
    most_patches_off,
    noise_of_parts,
    outlier_share,
    wavy_limit,
)
from dqreg.trust.question import asks, if_asked, in_sizes


def counted(evidence: Evidence) -> str:
    """The points that the fraction of inliers is of."""
    return "the points" if counts_all(evidence) else f"the points within {evidence.length(evidence.near)} of the target"


@asks(
    "few_inliers",
    "Inliers at distinct places",
    "at least",
    "points",
    lambda e: (math.nan if math.isnan(e.places) else e.distinct_inliers, MIN_INLIERS),
    must_be_known=True,
)
def few_inliers(evidence: Evidence) -> Iterator[str]:
    """Too few points lie on the target to tell anything."""
    if not evidence.inliers >= MIN_INLIERS:
        yield f"only {evidence.inliers:.0f} inliers: too few to check the pose"
    else:
        yield f"the inliers lie at {evidence.places:.0f} distinct places only: too few to check the pose"


@asks(
    "low_inlier_fraction",
    "Inliers among the points near the target",
    "at least",
    "1",
    lambda e: (e.share_near, MIN_FRACTION_OF_ALL if counts_all(e) else MIN_INLIER_FRACTION),
    must_be_known=True,
)
def low_inlier_fraction(evidence: Evidence) -> Iterator[str]:
    """Many points near the target are not on it."""
    cause = "the pose may have slipped" if counts_all(evidence) else "a local minimum, another part, or much clutter"
    yield (
        f"only {100 * evidence.share_near:.0f} % of {counted(evidence)} are inliers (residuals of "
        f"{evidence.length(evidence.width)}, one sigma): {cause}"
    )


@asks(
    "falling_inlier_fraction",
    "Inliers against the frames before",
    "at least",
    "1",
    lambda e: (math.nan if math.isnan(e.usual) else e.share_near, MIN_RATIO_TO_EARLIER * e.usual),
)
def falling_inlier_fraction(evidence: Evidence) -> Iterator[str]:
    """A frame has fewer of them than those before."""
    yield (
        f"{100 * evidence.share_near:.0f} % of {counted(evidence)} are inliers, after "
        f"{100 * evidence.usual:.0f} % in the frames before: the pose may have slipped, or the view is new"
    )


@asks(
    "deviating_patches",
    "Patches that deviate as a whole",
    "at most",
    "1",
    lambda e: (e.patches_off - e.patches_deformed, most_patches_off(e)),
    must_be_known=True,
)
def deviating_patches(evidence: Evidence) -> Iterator[str]:
    """Patches of neighbouring points lie off the target."""
    yield (
        f"{100 * (evidence.patches_off - evidence.patches_deformed):.0f} % of the patches of points within "
        f"{evidence.length(evidence.near)} of the target deviate as a whole: a local minimum, another part, or an "
        "object that touches the part"
    )


def _contradicting(evidence: Evidence) -> tuple[float, float]:
    if _goes_on(evidence):
        return evidence.going_on, GOING_ON_SHARE
    return evidence.contradiction, OFF_FACE_SHARE


def _goes_on(evidence: Evidence) -> bool:
    return not evidence.contradiction > OFF_FACE_SHARE and evidence.going_on > GOING_ON_SHARE


@asks("contradicting_surface", "Surface of the part itself off the target", "at most", "1", _contradicting)
def contradicting_surface(evidence: Evidence) -> Iterator[str]:
    """The scan's own faces go on where the target ends."""
    if _goes_on(evidence):
        yield (
            f"beside {100 * evidence.going_on:.0f} % of the points on the target the scan goes on beyond it in their "
            f"plane, and {100 * evidence.share_on:.2g} % of the scan are on it: a corner of something larger; check "
            "the units, or cut the scan to the part"
        )
    else:
        yield (
            f"{100 * evidence.share_contradicting:.0f} % of the scan are faces that continue beyond the target or meet "
            f"it in a convex edge, and {100 * evidence.share_on:.0f} % are on it: another part, or a wrong pose"
        )


def _off_the_target(evidence: Evidence) -> tuple[float, float]:
    limit = most_clutter(evidence)
    if math.isnan(limit):
        return math.nan, CLUTTER_SHARE
    share_on = evidence.share_on + evidence.share_deformed
    off = if_asked(1.0 - share_on)
    # What is just within the limit is not rounded beyond it.
    return min(off, limit) if share_on >= 1.0 - limit else off, limit


@asks("clutter", "Points off the target, of a scan no larger than the part", "at most", "1", _off_the_target)
def clutter(evidence: Evidence) -> Iterator[str]:
    """A scan of the part alone is off it."""
    is_alone, share_on = evidence.clutter == "none", evidence.share_on + evidence.share_deformed
    why = 'it is said to show alone (clutter="none")' if is_alone else "is no smaller than the scan"
    off = f"{100 * (1.0 - share_on):.0f} % of the scan are off the target"
    yield f"{off}, which {why}: a wrong pose, another part, or other objects"


@asks(
    "looked_through",
    "Points where a scanner looked through",
    "at most",
    "1",
    lambda e: (e.looked_through, looked_through_limit(e)),
)
def looked_through(evidence: Evidence) -> Iterator[str]:
    """Things stand where a scanner looked through."""
    yield (
        f"{100 * evidence.looked_through:.0f} % of the points compared stand where a scanner looked through: a "
        "wrong pose, a wrong viewpoint, or things that moved between the scans"
    )


@asks(
    "disagreeing_normals",
    "Inliers with another normal than the target",
    "at most",
    "1",
    lambda e: (e.normals_apart, DISAGREEING_NORMAL_SHARE),
    must_be_known=True,
)
def disagreeing_normals(evidence: Evidence) -> Iterator[str]:
    """Points on the target face another way."""
    yield (
        f"{100 * evidence.normals_apart:.0f} % of the inliers have normals that disagree with the target: a local "
        "minimum, another part, or normals that were given without a side"
    )


@asks("outliers", "Points of the whole scan amid no smooth surface", "at most", "1", outlier_share, must_be_known=True)
def outliers(evidence: Evidence) -> Iterator[str]:
    """Points on no surface outnumber the others."""
    yield (
        f"{100 * outlier_share(evidence)[0]:.0f} % of all points are outliers amid no smooth surface, and only "
        f"{evidence.inliers:.0f} are inliers: clean the scan, or check the pose"
    )


def _residuals(evidence: Evidence) -> tuple[float, float]:
    noise = noise_of_parts(evidence)
    return if_asked(evidence.width) / noise if noise > 0.0 else math.nan, RESIDUAL_NOISE_RATIO


@asks("large_residuals", "Residuals against the noise of the scan", "at most", "times", _residuals)
def large_residuals(evidence: Evidence) -> Iterator[str]:
    """The residuals are far beyond the noise of scan and part."""
    noise = noise_of_parts(evidence)
    yield (
        f"the residuals are {evidence.length(evidence.width)} (one sigma), "
        f"{evidence.width / noise:.0f} times the scan's own noise "
        f"({evidence.length(noise)}): the shapes differ, or the pose is wrong"
    )


@asks(
    "local_difference",
    "Points beside each other off the target, of a scan of a detail",
    "at most",
    "1",
    lambda e: (if_asked(e.share_together) if e.is_detail else math.nan, 0.0),
)
def local_difference(evidence: Evidence) -> Iterator[str]:
    """A scan of a detail, which may be another one, differs from it."""
    yield (
        f"the scan shows a detail of the target, and {100 * evidence.share_together:.2g} % of it lie beside each "
        "other off the target: it may fit better elsewhere; scan more of the part"
    )


@asks(
    "wavy",
    "Residuals that neighbouring points have in common, of the size",
    "at most",
    "1",
    lambda e: (in_sizes(e, e.waviness), wavy_limit(e)),
)
def wavy(evidence: Evidence) -> Iterator[str]:
    """Neighbouring residuals have much in common."""
    yield (
        f"neighbouring points deviate together, by {evidence.length(evidence.waviness)} "
        f"({100 * evidence.waviness / evidence.size:.2g} % of the size, one sigma): waves or dents all over, as "
        "of a scanner that shakes, another shape, or a wrong pose"
    )


@asks(
    "random_fit",
    "Residuals against those at random poses",
    "at most",
    "1",
    lambda e: (e.random_ratio, chance_limit(e)),
    must_be_known=True,
)
def random_fit(evidence: Evidence) -> Iterator[str]:
    """Chance fits the scan nearly as well."""
    yield (
        f"the residuals are {100 * evidence.random_ratio:.0f} % of those at random poses: the scan does not show "
        "the shape of the target"
    )
