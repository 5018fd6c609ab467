"""The verdict: accepted, suspect or failed, with its reasons."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator

from dqreg.trust import fit_questions as fit
from dqreg.trust import motion_questions as motion
from dqreg.trust import shape_questions as shape
from dqreg.trust.confidence import figures_of, probability
from dqreg.trust.evidence import Evidence
from dqreg.trust.free_space import MAX_HIDDEN_SHARE
from dqreg.trust.limits import MIN_PAIRS_OF_POSE, OPPOSITE_NORMAL_SHARE
from dqreg.trust.question import Question
from dqreg.trust.records import Check, Level, Reason, Verdict

# Confidence below which a pose is not accepted though no figure alone speaks against it: of 186 such poses of the
# tuning seeds two wrong ones came to 0.87 at most, and right ones, but for one among 60 % strays, to 0.965 and more.
UNLIKELY = 0.9447

# In the order in which a verdict names them.
QUESTIONS: tuple[Question, ...] = (
    fit.few_inliers,
    fit.low_inlier_fraction,
    fit.falling_inlier_fraction,
    # Before what the shape seems to be at a pose that is held where the scan does not fit.
    motion.forbidden_motion,
    # Before the mirror image: a part that shrank feigns one.
    shape.stretched,
    motion.mirrored,
    fit.deviating_patches,
    fit.contradicting_surface,
    fit.clutter,
    fit.looked_through,
    shape.faces_apart,
    shape.ends_apart,
    shape.rims_apart,
    shape.rims_elsewhere,
    shape.opposed_edges,
    shape.closed_hole,
    shape.one_plane,
    fit.disagreeing_normals,
    fit.outliers,
    fit.large_residuals,
    fit.local_difference,
    fit.wavy,
    shape.bent,
    shape.deformed,
    shape.drift,
    fit.random_fit,
    motion.unconstrained,
    motion.large_uncertainty,
    motion.weakly_constrained,
    motion.alternative_poses,
    motion.search_time_limit,
    motion.not_converged,
)


def judge(evidence: Evidence) -> Verdict:
    """Level and reasons.

    Parameters
    ----------
    evidence : Evidence
        What is known about the run.

    Returns
    -------
    Verdict
        "failed" where there is no pose, "suspect" where something speaks against it, else "accepted".

    Examples
    --------
    >>> nothing = Evidence("no correspondences", False, 0.0, 0.0, 0.5, 0, 0, 0, 0, 0, 0, 20.0, (), (), units="mm")
    >>> judge(nothing).level, judge(nothing).codes
    ('failed', ('no_correspondences',))
    """
    if not evidence.found:
        return Verdict("failed", (_why_nothing(evidence),))
    doubts = tuple(doubt for question in QUESTIONS for doubt in question.doubts(evidence))
    level: Level = "suspect" if doubts else "accepted"
    figures = figures_of(evidence, [doubt.code for doubt in doubts])
    confidence = probability(figures)
    # Asked where nothing else speaks against the pose, and where its size is known.
    together = confidence if not doubts and math.isfinite(evidence.size) else math.nan
    if together < UNLIKELY:
        doubts, level = (Reason(_unlikely(together), "low_confidence"),), "suspect"
    checks = functools.partial(_checks, evidence, together)
    doubts = (*_causes(evidence), *_with_symmetry(doubts, evidence)) if doubts else doubts
    reasons = doubts or (Reason(_summary(evidence), "accepted"), *_remarks(evidence))
    return Verdict.asking(level, reasons, checks, confidence, figures)


def _checks(evidence: Evidence, together: float) -> tuple[Check, ...]:
    return (*(question.check(evidence) for question in QUESTIONS), _together(together))


def _causes(evidence: Evidence) -> Iterator[Reason]:
    """What may explain all doubts of a pose, and is none of it alone."""
    if evidence.looking_away > OPPOSITE_NORMAL_SHARE:
        yield Reason(_looking_away(evidence), "wrong_viewpoint")
    elif evidence.viewpoint_behind > MAX_HIDDEN_SHARE:
        yield Reason(
            f"from the viewpoint given {100 * evidence.viewpoint_behind:.0f} % of the scan's own points stand behind "
            "others: it is not where the scanner stood, in the coordinates and units of the scan",
            "wrong_viewpoint",
        )


def _looking_away(evidence: Evidence) -> str:
    return (
        f"the normals of {100 * evidence.looking_away:.0f} % of the scan's points near the target look the other way "
        "than its faces: the viewpoint given is on the other side of the scan, or normals were given inside out"
    )


def _remarks(evidence: Evidence) -> Iterator[Reason]:
    """What a user of an accepted pose ought to know."""
    if evidence.share_together:
        yield Reason(
            f"{100 * evidence.share_together:.2g} % of the points near the target lie beside each other off it: the "
            "part differs there (a defect, another revision), or something touches it; the others hold the pose",
            "local_difference",
        )
    if math.isfinite(evidence.ends_apart) and math.isfinite(evidence.largest_plane):
        yield Reason(
            "the scans have three planes in common at most, which fit at any scale: whether one is scaled, mirrored, "
            "or stretched along an edge, cannot be told",
            "scale_unobservable",
        )


def _unlikely(confidence: float) -> str:
    return (
        f"no figure alone speaks against the pose, but all together make it right with a probability of "
        f"{100 * confidence:.0f} % only, less than {100 * UNLIKELY:.0f}: few or noisy points, or a weak fit"
    )


def _together(confidence: float) -> Check:
    question = "Probability of a right pose, by all figures together"
    passed = None if math.isnan(confidence) else confidence >= UNLIKELY
    return Check("low_confidence", question, confidence, "at least", UNLIKELY, "1", passed)


def _why_no_correspondences(evidence: Evidence) -> Reason:
    if evidence.looking_away > OPPOSITE_NORMAL_SHARE:
        return Reason(f"no pose: {_looking_away(evidence)}", "wrong_viewpoint")
    sides = ", which way the normals look, given or by the viewpoint" if math.isfinite(evidence.looking_away) else ""
    return Reason(
        f"no pose: hardly any scan point comes within {evidence.length(evidence.max_distance)} of the target with a "
        f"matching normal; check the initial pose and the units{sides}, or raise max_distance",
        "no_correspondences",
    )


def _why_nothing(evidence: Evidence) -> Reason:
    if evidence.status == "no correspondences":
        return _why_no_correspondences(evidence)
    if evidence.status == "degenerate correspondences":
        return Reason(
            "no pose: the correspondences lie on a line or at one point; scan more of the part, or check the initial "
            "pose",
            "degenerate_correspondences",
        )
    if evidence.inliers < MIN_PAIRS_OF_POSE:
        return Reason(
            f"no pose: {evidence.inliers:.2g} inliers, and a pose needs three at least; check the initial pose, the "
            "units, and that source and target show the same object",
            "too_few_points",
        )
    return Reason(f"no pose: ICP ended with the status {evidence.status!r}", "no_pose")


def _summary(evidence: Evidence) -> str:
    width = evidence.width if math.isnan(evidence._width_of_inliers) else evidence._width_of_inliers
    words = (
        f"{evidence.inliers:.0f} inliers with residuals of {evidence.length(width)} (one sigma), "
        f"{100 * evidence.share_near:.0f} % of {fit.counted(evidence)}; all degrees of freedom are constrained"
    )
    return words + _symmetry(evidence)


def _symmetry(evidence: Evidence) -> str:
    """What follows the words on a pose where the part looks the same at others; "" where it does not."""
    same = sorted({alternative.symmetry for alternative in evidence.alternatives if alternative.symmetry})
    return "".join(f"; {sentence}, so the pose is one of several equivalent ones" for sentence in same)


def _with_symmetry(doubts: tuple[Reason, ...], evidence: Evidence) -> tuple[Reason, ...]:
    """The doubts; the last one says that the part is symmetric: values may be of another face than is said."""
    last = doubts[-1]
    return (*doubts[:-1], Reason(f"{last}{_symmetry(evidence)}", last.code))
