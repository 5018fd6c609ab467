"""Why a pose should be believed: each question of the verdict with its figure and limit; passed, not, or not asked."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection

from dqreg.trust import limits
from dqreg.trust.code_sets import YES_OR_NO
from dqreg.trust.deformation import BETWEEN_CLOUDS, ON_A_PART
from dqreg.trust.doubts import DOUBTS
from dqreg.trust.evidence import Evidence
from dqreg.trust.records import Check, Code, Relation, Unit
from dqreg.trust.strain import MIN_BEND, MIN_DRIFT_DIAGONALS, MIN_STRAIN

Figures = Callable[[Evidence], tuple[float, float]]


def checks_of(evidence: Evidence, against: Collection[str]) -> tuple[Check, ...]:
    """All questions in the order of the verdict, given the codes of those that speak against the pose."""
    checks = []
    for code, _ in DOUBTS:
        asked = SLIDING if code == "weakly_constrained" and math.isfinite(evidence.sliding_loss) else QUESTIONS[code]
        question, relation, unit, figures = asked
        value, limit = figures(evidence)
        value = value if math.isfinite(value) else math.nan
        passed = None if _not_asked(code, value) and code not in against else code not in against
        checks.append(Check(code, question, value, relation, limit, unit, passed))
    return tuple(checks)


def _not_asked(code: Code, value: float) -> bool:
    return math.isnan(value) and code not in YES_OR_NO


def _inlier_share(evidence: Evidence) -> tuple[float, float]:
    least = limits.MIN_FRACTION_OF_ALL if limits.counts_all(evidence) else limits.MIN_INLIER_FRACTION
    return evidence.share_near, least


def _patches(evidence: Evidence) -> tuple[float, float]:
    return evidence.patches_off - evidence.patches_deformed, limits.most_patches_off(evidence)


def _contradicting(evidence: Evidence) -> tuple[float, float]:
    if not evidence.contradiction > limits.OFF_FACE_SHARE and evidence.going_on > limits.GOING_ON_SHARE:
        return evidence.going_on, limits.GOING_ON_SHARE
    return evidence.contradiction, limits.OFF_FACE_SHARE


def _clutter(evidence: Evidence) -> tuple[float, float]:
    limit = limits.most_clutter(evidence)
    off = math.nan if math.isnan(limit) else 1.0 - evidence.share_on - evidence.share_deformed
    return off, limits.CLUTTER_SHARE if math.isnan(limit) else limit


def _residuals(evidence: Evidence) -> tuple[float, float]:
    noise = limits.noise_of_parts(evidence)
    return evidence.width / noise if noise > 0.0 else math.nan, limits.RESIDUAL_NOISE_RATIO


# The next figures are 0 unless they are significant and reach their limits: smaller ones were not kept.
def _stretch(evidence: Evidence) -> tuple[float, float]:
    return abs(evidence.stretch), MIN_STRAIN


def _bend(evidence: Evidence) -> tuple[float, float]:
    return evidence.bend, MIN_BEND * evidence.deviation_ratio


def _deformation(evidence: Evidence) -> tuple[float, float]:
    # Of several limits, each with a significance of its own, the smallest.
    told = ON_A_PART if math.isnan(evidence.faces_apart) else BETWEEN_CLOUDS
    least = min(limit.shown for limit in (*told.few, *told.many))
    return evidence.deformation / evidence.size, least * evidence.deviation_ratio


def _drift(evidence: Evidence) -> tuple[float, float]:
    value = evidence.drift / evidence.size if evidence.size > 0.0 else evidence.drift
    least = MIN_DRIFT_DIAGONALS * evidence.deviation_ratio
    # Of two exposures every one counts.
    return value, least if value >= least or not value else 0.0


def _free(evidence: Evidence) -> tuple[float, float]:
    return float(sum(direction.is_free for direction in evidence.directions)), 0.0


def _uncertainty(evidence: Evidence) -> tuple[float, float]:
    most = limits.sigma_limits(evidence.size)
    known = [d.sigma / most[d.kind] for d in evidence.directions if d.kind in most]
    return max((value for value in known if math.isfinite(value)), default=math.nan), 1.0


def _carriers(evidence: Evidence) -> tuple[float, float]:
    held = zip(evidence.directions, evidence.carriers, strict=False)
    fewest = min((carriers for direction, carriers in held if not direction.is_free), default=math.nan)
    return fewest, limits.fewest_carriers(evidence.inliers, of_both=evidence.carriers_of_both)


def _others(evidence: Evidence) -> tuple[float, float]:
    return float(sum(not alternative._is_symmetric for alternative in evidence.alternatives)), 0.0


# Said of figures that exist beyond their limits only.
UNLESS = "; 0 unless it is above the limit and significant"
# What is asked, how the figure stands to its limit, and in which unit; a figure of NaN was not asked for.
QUESTIONS: dict[Code, tuple[str, Relation, Unit, Figures]] = {
    "few_inliers": (
        "Inliers at distinct places",
        "at least",
        "points",
        lambda e: (e.distinct_inliers, limits.MIN_INLIERS),
    ),
    "low_inlier_fraction": ("Inliers among the points near the target", "at least", "1", _inlier_share),
    "falling_inlier_fraction": (
        "Inliers against the frames before",
        "at least",
        "1",
        lambda e: (e.share_near if math.isfinite(e.usual) else math.nan, limits.MIN_RATIO_TO_EARLIER * e.usual),
    ),
    "forbidden_motion": (
        "Log-likelihood that a motion gains which dof= or prior= forbids",
        "at most",
        "",
        lambda e: (e.freed_gain, limits.FREED_GAIN),
    ),
    "stretched": (f"Strain against the target{UNLESS}", "at most", "1", _stretch),
    "mirrored": (
        "Log-likelihood that mirroring the scan gains",
        "at most",
        "",
        lambda e: (e.mirror_gain, limits.MIRROR_GAIN),
    ),
    "deviating_patches": ("Patches that deviate as a whole", "at most", "1", _patches),
    "contradicting_surface": ("Surface of the part itself off the target", "at most", "1", _contradicting),
    "clutter": ("Points off the target, of a scan no larger than the part", "at most", "1", _clutter),
    "looked_through": (
        "Points where a scanner looked through",
        "at most",
        "1",
        lambda e: (e.looked_through, limits.looked_through_limit(e)),
    ),
    "faces_apart": (
        "Places that both scans show and that lie apart",
        "at most",
        "1",
        lambda e: (e.faces_apart, limits.FACES_APART_SHARE),
    ),
    "ends_apart": (
        "Faces in the only common planes that reach beyond the other scan",
        "at most",
        "1",
        lambda e: (e.ends_apart, limits.ends_limit(e)),
    ),
    "rims_apart": (
        "Rims of faces in the only common planes that both scans show",
        "at least",
        "1",
        lambda e: (e.rims_shared, limits.rims_limit(e)),
    ),
    "rims_elsewhere": (
        "Rims of those faces that both scans show after a slide, more than at the pose",
        "at most",
        "1",
        lambda e: (e.rims_elsewhere[0], limits.RIM_GAIN_SHARE),
    ),
    "opposed_edges": (
        "Rims of both scans in one plane beside which the faces turn to opposite sides",
        "at most",
        "1",
        lambda e: (e.opposed_edges, limits.OPPOSED_EDGE_SHARE),
    ),
    "closed_hole": (
        "Diameter of a hole in one scan's face that the other's face closes, of the size",
        "at most",
        "1",
        lambda e: (e.closed_hole / e.size, limits.CLOSED_HOLE_DIAGONALS),
    ),
    "one_plane": (
        "Places that both scans show in one plane",
        "at most",
        "1",
        lambda e: (e.largest_plane, limits.ONE_PLANE_SHARE),
    ),
    "disagreeing_normals": (
        "Inliers with another normal than the target",
        "at most",
        "1",
        lambda e: (e.normals_apart, limits.DISAGREEING_NORMAL_SHARE),
    ),
    "outliers": (
        "Points of the whole scan amid no smooth surface",
        "at most",
        "1",
        limits.outlier_share,
    ),
    "large_residuals": ("Residuals against the noise of the scan", "at most", "times", _residuals),
    "local_difference": (
        "Points beside each other off the target, of a scan of a detail",
        "at most",
        "1",
        lambda e: (e.share_together if e.is_detail else math.nan, 0.0),
    ),
    "wavy": (
        "Residuals that neighbouring points have in common, of the size",
        "at most",
        "1",
        lambda e: (e.waviness / e.size, limits.wavy_limit(e)),
    ),
    "bent": (f"Bend, sagitta over length{UNLESS}", "at most", "1", _bend),
    "deformed": (
        f"Smooth deformation of the scan against the target, of the size{UNLESS}",
        "at most",
        "1",
        _deformation,
    ),
    "drift": (f"Drift of the pose along the scan, of the size{UNLESS}", "at most", "1", _drift),
    "random_fit": (
        "Residuals against those at random poses",
        "at most",
        "1",
        lambda e: (e.random_ratio, limits.chance_limit(e)),
    ),
    "unconstrained": ("Unconstrained motions", "at most", "motions", _free),
    "large_uncertainty": (
        f"Standard deviation against {math.degrees(limits.MAX_SIGMA_RAD):g} degrees or "
        f"{100.0 * limits.MAX_SIGMA_DIAGONALS:g} % of the size",
        "at most",
        "times",
        _uncertainty,
    ),
    "weakly_constrained": ("Points that constrain the weakest motion", "at least", "points", _carriers),
    "alternative_poses": ("Other poses that are equally likely", "at most", "poses", _others),
    "search_time_limit": ("The global search was finished", "at most", "", lambda e: (math.nan, 0.0)),
    "not_converged": ("ICP converged", "at most", "", lambda e: (math.nan, 0.0)),
}
# Asked in place of the number of points where they are few.
SLIDING: tuple[str, Relation, Unit, Figures] = (
    "Log-likelihood that a displacement along the weakest motion costs",
    "at least",
    "",
    lambda e: (e.sliding_loss, limits.CONSTRAINT_LOG_LIKELIHOOD),
)
