"""The limits of the verdict's tests, and where right and wrong poses came to."""

from __future__ import annotations

import math

from dqreg.solvers.motion_words import Kind
from dqreg.trust.evidence import Evidence

# Inliers below this fraction of the points near the target: a local minimum, another part, or much clutter.
MIN_INLIER_FRACTION = 0.7
# The same where all points count (odometry), and as a ratio to the frames before.
MIN_FRACTION_OF_ALL, MIN_RATIO_TO_EARLIER = 0.5, 0.75
# Fewer inliers determine a pose of six unknowns with nothing left to check it.
MIN_INLIERS = 30
# Fewer fix no pose at all.
MIN_PAIRS_OF_POSE = 3
# Patches of neighbouring points that deviate as a whole, of all patches: above this they speak against the pose.
DEVIATING_PATCH_SHARE = 0.03
# The same of inliers with another normal than the target's.
DISAGREEING_NORMAL_SHARE = 0.15
# The same of points that lie on no surface.
OUTLIER_SHARE = 0.5
# Points neither on the target nor on any surface off it, where so few points are there that outliers are not told from
# others: a right pose among 60 % of outliers came to 0.6, a scan 2.2 to 3 times as large as its part to 0.86 and more.
SURFACELESS_SHARE = 0.7
# Two scans of one scene see different sides of things, and things move.
DEVIATING_PATCH_SHARE_AT_BORDER = 0.12
# Outliers take some patches along: so many more may deviate for each of them.
DEVIATING_PATCHES_PER_OUTLIER = 0.25
# Residuals this many times the scan's own noise: the shapes differ, or the pose is wrong.
RESIDUAL_NOISE_RATIO = 5.0
# Less noise than this, in sizes, is none to that: parts and scanners deviate in patches too.
MIN_NOISE_DIAGONALS = 4e-4
# Mean log-likelihood that mirroring the scan may gain: good scans lose 0.25 and more, mirrored ones gain as much.
MIRROR_GAIN = 0.015
# The same of a motion that is locked, or held by a prior, asked where the residuals or that gain are too large.
FREED_GAIN = 0.02
# Residuals over those at random poses: scans come to 0.09 at most, noise that was accepted to 0.4 and more.
CHANCE_RATIO = 0.25
# Share of the scan on the target below which that ratio is to be less, in proportion.
CHANCE_RATIO_SHARE = 0.5
# The same in proportion of fewer inliers than these: a search over poses takes its pick. Of 36 to 108 points right
# poses came to 0, those of other parts to 0.12 and more.
CHANCE_RATIO_INLIERS = 200
# Standard deviations of the pose beyond these are no answer: rotations, and translations in sizes of the target.
MAX_SIGMA_RAD, MAX_SIGMA_DIAGONALS = math.radians(2.0), 0.02
# A motion constrained by fewer points than this, and by this fraction of the inliers, depends on a detail or outliers.
MIN_CARRIERS, MIN_CARRIER_SHARE = 30.0, 0.02
# The same where those of two scans are counted on which the normals of both agree, whatever the number of inliers:
# chance alone reaches 10 of them.
MIN_CARRIERS_OF_BOTH = 20.0
# But not where displacements along it cost the whole scan so much log-likelihood: chance reaches it once in 10^8.
CONSTRAINT_LOG_LIKELIHOOD = 20.0
# Surface of the part itself off the target, in shares of the faces on it and off. Right poses came to 0 but for one of
# 172 on a table (0.1), blocks half as long again to 0.15 and more.
OFF_FACE_SHARE = 0.12
# Points on the target beside which a scan that is larger goes on in their plane. Of 40 parts on tables with clutter the
# right poses came to 0.001, poses on a corner of 40 to 80 points of something 5 to 30 times as large to 0.26 and more.
GOING_ON_SHARE = 0.12
# Points off a part that is said to be alone.
CLUTTER_SHARE = 0.05
# Points off a closed part where the scan is no larger than it: beside outliers, and with them. Other objects reach
# beyond the part; of 416 good scans of the sweep 0.4 % were off beside outliers at most.
OFF_PART_SHARE, OFF_PART_SHARE_WITH_OUTLIERS = 0.06, 0.35
# Residuals that neighbours have in common, one sigma, in sizes: waves with an amplitude of 0.2 %. Right poses of
# generated scans came to 0.0005, measured ones to 0.0011, of which little was in common.
WAVINESS_DIAGONALS = 1.5e-3
# The same between two clouds, where it is 1.8 times the noise from point to point: ripples of 0.3 to 0.6 % came to 1.9
# times and more, right poses of measured pairs to 1.65, and a LiDAR on a street to 5 at 0.00022.
WAVINESS_DIAGONALS_OF_CLOUDS = 5e-4
# Normals that look the other way than the target beside them: more than half of them are no matter of the pose.
OPPOSITE_NORMAL_SHARE = 0.5
# Points where a scanner looked through: right poses of depth cameras and LiDARs came to 0.004, wrong ones to 0.05.
DEPTH_CONFLICT_SHARE = 0.05
# The same by rays, of two scans from places amid what they show.
RAY_CONFLICT_SHARE = 0.035
# Share that rays may have passed through, and of all points that they must have met as far, where they tell that faces
# end where they end in both of two scans.
MAX_RAY_PASS_SHARE, MIN_RAY_MEETING_SHARE = 0.01, 0.3
# Places of two scans that lie apart: right poses of measured pairs came to 0.025, most ripples of 0.4 % to 0.07.
FACES_APART_SHARE = 0.03
# Faces beyond those of the other scan, where both have a few planes in common at most: right poses of generated views
# came to 0.02, one in 42 to 0.1; other parts to 0.05 and more.
FACE_OVERHANG_SHARE = 0.04
# More may where so much of their rims is shared: a LiDAR's faces end where its beams do (0.07, of rims 0.85); of 28
# other poses above the limit none came to more than 0.56.
OVERHANG_SHARED_RIMS, FACE_OVERHANG_SHARE_WITH_RIMS = 0.75, 0.12
# Rims of those faces that both show, of the scan with more of them: right poses of generated views came to 0.68 and
# more, corners of two parts to 0.12, 0.23 and 0.50, a corner of a block at another one to 0.02. With four to six planes
# rooms take part, whose faces end as far as a LiDAR saw them from either place: of 42 right pairs the least came to
# 0.21, with up to 0.26 of the faces beyond each other, corners of two parts to 0 and 0.03.
SHARED_RIM_SHARE, SHARED_RIM_SHARE_OF_MANY_PLANES = 0.6, 0.12
# The same where less than this share of what is compared is common to both: corners of prisms came to 0.37 and 0.22 of
# the rims with 0.26 and 0.32 of the places, right poses of views to 0.63 and more, rooms to 0.41 of the places.
LITTLE_COMMON_SHARE, SHARED_RIM_SHARE_OF_LITTLE = 0.36, 0.5
# Diameter of a hole that is closed in the other scan, in sizes: holes of wrong faces came to 0.07 and more, shadows of
# poles before a LiDAR to 0.012.
CLOSED_HOLE_DIAGONALS = 0.03
# Rims of one plane beside which the faces turn to opposite sides: right poses of 120 pairs of generated views came to
# 0.15, both sides of a wall laid on each other to 1 in six pairs of seven, and to 0.6.
OPPOSED_EDGE_SHARE = 0.4
# More of them after a slide by up to 6 % of the size: right poses of 64 pairs of generated views came to 0.03, both
# sides of a thin wall laid on each other to 0.28, 0.30 and 0.26.
RIM_GAIN_SHARE = 0.15
# Share of the common places in one plane: right poses of generated views came to 0.973, both sides of a plate laid on
# each other to 0.991.
ONE_PLANE_SHARE = 0.985


def most_patches_off(evidence: Evidence) -> float:
    """Share of the patches that may deviate: more among strays, but points beside each other are none."""
    allowed = DEVIATING_PATCH_SHARE_AT_BORDER if evidence.has_border else DEVIATING_PATCH_SHARE
    return allowed + DEVIATING_PATCHES_PER_OUTLIER * max(evidence.strays - evidence.share_together, 0.0)


def most_clutter(evidence: Evidence) -> float:
    """Share of the scan that may lie off the target; NaN where any may."""
    if evidence.clutter == "none":
        return CLUTTER_SHARE
    return math.nan if evidence.is_scene else min(evidence.strays + OFF_PART_SHARE, OFF_PART_SHARE_WITH_OUTLIERS)


def own_noise(evidence: Evidence) -> float:
    """The scan's own noise, by its neighbourhoods or from point to point: curved faces look noisy to the former."""
    local = max(evidence.local_noise, _least_noise(evidence))
    return min(evidence.expected, local) if math.isfinite(evidence.local_noise * evidence.size) else evidence.expected


def noise_of_parts(evidence: Evidence) -> float:
    """That noise, or what made parts deviate by all the same: good scanners see it."""
    of_parts = _least_noise(evidence) if math.isfinite(evidence.local_noise * evidence.size) else 0.0
    return max(own_noise(evidence), of_parts)


def _least_noise(evidence: Evidence) -> float:
    return MIN_NOISE_DIAGONALS * evidence.size * evidence.deviation_ratio


def is_rough(evidence: Evidence) -> bool:
    """Whether the residuals are far beyond the scan's own noise."""
    noise = own_noise(evidence)
    return noise > 0.0 and not evidence.width <= RESIDUAL_NOISE_RATIO * noise


def sigma_limits(size: float) -> dict[Kind, float]:
    """Largest standard deviations of motions of a target of a size, rotations as displacements at half of it."""
    return {"rotation": 0.5 * MAX_SIGMA_RAD * size, "translation": MAX_SIGMA_DIAGONALS * size}


def fewest_carriers(inliers: float, *, of_both: bool = False) -> float:
    """Fewer points that constrain a motion may be a detail or outliers; of both: those on which two scans agree."""
    return MIN_CARRIERS_OF_BOTH if of_both else min(MIN_CARRIERS, MIN_CARRIER_SHARE * inliers)


def counts_all(evidence: Evidence) -> bool:
    """Whether all points count, as of a frame of a sequence."""
    return math.isinf(evidence.near)


def fraction_fits(fraction: float, usual: float) -> bool:
    """Whether neither question about the fraction of inliers speaks against a frame.

    >>> fraction_fits(0.6, 0.7), fraction_fits(0.6, 0.9), fraction_fits(0.4, float("nan"))
    (True, False, False)
    """
    return fraction >= MIN_FRACTION_OF_ALL and not fraction < MIN_RATIO_TO_EARLIER * usual


def chance_limit(evidence: Evidence) -> float:
    """Largest random ratio: where a pose leaves most of a scan off the target, it was chosen for the rest alone.

    It is smaller for few inliers: among so many poses as a search sees, one fits few points by chance.
    """
    of_the_part = min(1.0, evidence.share_on / CHANCE_RATIO_SHARE)
    return CHANCE_RATIO * of_the_part * min(1.0, evidence.distinct_inliers / CHANCE_RATIO_INLIERS)


def wavy_limit(evidence: Evidence) -> float:
    """Largest deviation that neighbours may have in common, in sizes; between clouds one above their noise is told."""
    is_part = math.isnan(evidence.faces_apart)
    return WAVINESS_DIAGONALS * evidence.deviation_ratio if is_part else WAVINESS_DIAGONALS_OF_CLOUDS


def looked_through_limit(evidence: Evidence) -> float:
    """Share of the points that a scanner may have looked through: less where its own rays tell."""
    return DEPTH_CONFLICT_SHARE if math.isnan(evidence.seen_alike) else RAY_CONFLICT_SHARE


def rays_agree(evidence: Evidence) -> bool:
    """Whether the rays of two scans met much of each other's, and passed through next to nothing."""
    return evidence.seen_alike >= MIN_RAY_MEETING_SHARE and evidence.looked_through <= MAX_RAY_PASS_SHARE


def ends_limit(evidence: Evidence) -> float:
    """Share of two scans' faces that may reach beyond the other's: more where their rims are the same.

    In more planes than a corner has, any may where the rims are.
    """
    if math.isnan(evidence.largest_plane) and evidence.rims_shared >= SHARED_RIM_SHARE_OF_MANY_PLANES:
        return 1.0
    return FACE_OVERHANG_SHARE_WITH_RIMS if evidence.rims_shared >= OVERHANG_SHARED_RIMS else FACE_OVERHANG_SHARE


def rims_limit(evidence: Evidence) -> float:
    """Least share of the rims that two scans have in common: less of many planes, unless both show little."""
    if math.isfinite(evidence.largest_plane):
        return SHARED_RIM_SHARE
    is_little = evidence._common < LITTLE_COMMON_SHARE
    return SHARED_RIM_SHARE_OF_LITTLE if is_little else SHARED_RIM_SHARE_OF_MANY_PLANES


def outlier_share(evidence: Evidence) -> tuple[float, float]:
    """Share of all points that lie on no surface, by neighbourhoods or by segments, and its limit."""
    is_nowhere = evidence.share_nowhere > SURFACELESS_SHARE
    return (evidence.share_nowhere, SURFACELESS_SHARE) if is_nowhere else (evidence.strays, OUTLIER_SHARE)
