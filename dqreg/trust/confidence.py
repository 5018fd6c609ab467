"""Confidence of a verdict: the probability that the pose is right, from the figures of the evidence.

A logistic map, fitted on tasks of the trust sweep; `dqreg compare --sweep trust --fit-confidence` fits it anew. It is a
probability among such tasks, of which about a third are good: where bad ones are rarer, right poses are more probable.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import noise_of_parts, rays_agree

# Weight of each figure in the logarithm of the odds, and what is added to all of them: fitted to 892 tasks, stretched
# by two numbers twice, then shifted by 2.76, and that of doubted poses by -2.27, for 1,357 tasks of seeds 8143 to 8158
# (calibration error 1.5 %, cross-validated; 3.0 before).
OFFSET = 2.5375
WEIGHTS: dict[str, float] = {
    "suspect": -4.6870,
    "doubts": -0.6221,
    "inliers": 0.0000,
    "inliers_near": 0.0000,
    "patches_off": -0.0267,
    "normals_apart": 0.0000,
    "width": -1.5463,
    "random_ratio": -1.2448,
    "sigma": -0.8371,
    "carriers": 0.0000,
    "rivals": -2.7899,
    "strays": -0.0731,
    "contradicting": -2.5823,
    "other_objects": 1.4190,
    "strain": -1.9841,
    "border": -0.1527,
    "searched": -1.4653,
    "unconverged": -1.1315,
    # By hand, for 694 poses between clouds against which nothing speaks, of seeds 8000 to 8231 (689 of them right):
    # with three planes in common at most four are wrong, with more one. 676 are above the limit (662 before).
    "many_planes": 0.8,
    "rims_apart": -1.0,
    # By hand, for rooms: right poses of a search with sparse rings came to 0.76 without it, no wrong one has it.
    "rays_agree": 2.0,
}

NAMES = tuple(WEIGHTS)


def figures_of(evidence: Evidence, codes: Sequence[str]) -> dict[str, float]:
    """The figures by name: ratios, shares and logarithms, each of the order of one; codes of the doubts.

    None where there is no pose, and for frames of a sequence, which have no size.
    """
    if not evidence.found or math.isinf(evidence.near):
        return {}
    sigmas = [direction.sigma / evidence.size for direction in evidence.directions]
    noise = max(evidence.expected, noise_of_parts(evidence))
    wide = evidence.width / noise if noise > 0.0 else 1.0
    figures = {
        "suspect": float(bool(codes)),
        "doubts": float(min(len(set(codes)), 4)),
        "inliers": _log(evidence.inliers, 0.0, 4.0),
        "inliers_near": evidence.share_near,
        "patches_off": min(10.0 * evidence.patches_off, 3.0),
        "normals_apart": min(10.0 * evidence.normals_apart, 3.0),
        "width": _log(wide, -1.0, 1.5),
        "random_ratio": min(10.0 * evidence.random_ratio, 5.0),
        # Where all motions are locked none is uncertain.
        "sigma": max((_log(sigma, -5.0, 0.0) for sigma in sigmas), default=-5.0),
        "carriers": min((_log(carriers, 0.0, 3.0) for carriers in evidence.carriers), default=3.0),
        "rivals": float(min(len(evidence._other_poses), 2)),
        "strays": evidence.strays,
        "contradicting": min(10.0 * evidence.share_contradicting, 3.0),
        "other_objects": evidence.share_other,
        "strain": min(100.0 * abs(evidence.stretch), 3.0),
        "border": float(evidence.has_border),
        "searched": float(bool(evidence.search)),
        "unconverged": float(evidence.status != "converged"),
        # What two clouds have in common, where nothing else speaks against the pose.
        "many_planes": float(not codes and math.isfinite(evidence.faces_apart) and math.isnan(evidence.largest_plane)),
        "rims_apart": 1.0 - evidence.rims_shared if math.isfinite(evidence.largest_plane) else 0.0,
        "rays_agree": float(not codes and rays_agree(evidence)),
    }
    return {name: value if math.isfinite(value) else 0.0 for name, value in figures.items()}


def probability(figures: Mapping[str, float]) -> float:
    """Probability that the pose is right, by the logistic map; NaN where there are no figures.

    >>> 0.0 < probability({"inliers": 3.0}) < 1.0
    True
    """
    if not figures:
        return math.nan
    logit = OFFSET
    for name, value in figures.items():
        logit += WEIGHTS.get(name, 0.0) * value
    return 1.0 / (1.0 + math.exp(-max(-30.0, min(30.0, logit))))


def _log(value: float, low: float, high: float) -> float:
    # A motion that is free, or a number that is missing, is the worst there is.
    if math.isnan(value):
        return high
    found = math.log10(value) if value > 1e-300 else -300.0
    return low if found < low else high if found > high else found
