"""The verdict: accepted, suspect or failed, with its reasons in sentences."""

from __future__ import annotations

import dataclasses

from dqreg.records import Alternative, Direction, Level, Verdict

# Points on the target fewer than this share of the points near it: a wrong minimum, another part, or much clutter.
FEW_INLIERS = 0.7
# Inliers fewer than this cannot carry a pose of six unknowns with anything left to check it.
FEWEST_INLIERS = 30
# Distances this many times the scan's own noise: the shapes differ, or the pose is wrong.
ROUGH = 5.0


@dataclasses.dataclass(frozen=True)
class Evidence:
    """What the verdict is made of.

    Attributes
    ----------
    status : str
        How the loop ended.
    found : bool
        Whether there is a pose at all.
    inliers : float
        Sum of the inlier probabilities.
    share_near, near : float
        Share of points that lie on the target among those that come within the distance ``near`` of it.
    width, expected, spacing : float
        Standard deviation of the inliers' distances, the scan's own noise, and its spacing; all lengths.
    to_cloud : bool
        Whether the target is a cloud: then a distance holds the spacing of its points as well.
    max_distance : float
        Largest distance of a pair.
    directions : tuple of Direction
        The six motions, the weakest first.
    alternatives : tuple of Alternative
        Other poses as good.
    """

    status: str
    found: bool
    inliers: float
    share_near: float
    near: float
    width: float
    expected: float
    spacing: float
    to_cloud: bool
    max_distance: float
    directions: tuple[Direction, ...]
    alternatives: tuple[Alternative, ...]


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
    """
    if not evidence.found:
        return Verdict("failed", (_why_nothing(evidence),))
    doubts = [sentence for sentence in _doubts(evidence) if sentence]
    level: Level = "suspect" if doubts else "accepted"
    return Verdict(level, tuple(doubts) or (_summary(evidence),))


def _why_nothing(evidence: Evidence) -> str:
    if evidence.status == "no correspondences":
        return (
            f"no pose: hardly any scan point comes within {evidence.max_distance:.4g} of the target with a matching "
            "normal; check the start and the units, or raise max_distance"
        )
    return f"no pose: the loop ended with {evidence.status!r}"


def _summary(evidence: Evidence) -> str:
    return (
        f"{evidence.inliers:.0f} points lie on the target to {evidence.width:.3g} (one sigma), "
        f"{100 * evidence.share_near:.0f} % of those within {evidence.near:.3g} of it; all six motions are held"
    )


def _doubts(evidence: Evidence) -> list[str]:
    doubts = []
    # "Not enough" instead of "too little": a number that is NaN must not pass.
    if not evidence.inliers >= FEWEST_INLIERS:
        doubts.append(f"only {evidence.inliers:.0f} points lie on the target: too few to check the pose with")
    if not evidence.share_near >= FEW_INLIERS:
        doubts.append(
            f"only {100 * evidence.share_near:.0f} % of the points within {evidence.near:.3g} of the target "
            f"lie on it (to {evidence.width:.3g}): a wrong minimum, another part, or much clutter"
        )
    expected = max(evidence.expected, evidence.spacing if evidence.to_cloud else 0.0)
    if expected > 0.0 and not evidence.width <= ROUGH * expected:
        doubts.append(
            f"the points lie {evidence.width:.3g} off the target (one sigma), {evidence.width / expected:.0f} times "
            f"what the scan's own noise ({evidence.expected:.3g}) explains: shapes differ, or the pose is wrong"
        )
    doubts.extend(d.words for d in evidence.directions if d.words.startswith("free"))
    if evidence.alternatives:
        doubts.append(f"{len(evidence.alternatives)} other pose(s) explain the scan about as well: see alternatives")
    if evidence.status != "converged":
        doubts.append(f"the loop did not converge: {evidence.status}")
    return doubts
