"""The verdict of one frame, and the registrations of frames that have no run to show."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.registration.result import Registration
from dqreg.solvers.status import Status
from dqreg.trust.records import Direction, Reason, Verdict

# Share of points on the map below which a frame fits badly: in itself, and against the frames before it.
FEW_ON_MAP, FALL = 0.5, 0.75
# Share below which there is no pose to speak of: a frame of another place reaches 0.3.
LOST = 1.0 / 3.0
# Points on the map fewer than this cannot carry a pose of six unknowns with anything left to check it.
FEWEST_INLIERS = 30


@dataclasses.dataclass(frozen=True)
class FrameEvidence:
    """What the verdict of a frame is made of."""

    status: Status  # How the loop ended
    found: bool  # Whether there is a pose at all
    inliers: float  # Sum of the probabilities of points to lie on the map
    on_map: float  # The same as a share of the frame's points
    usual: float  # The same, median over the frames before; NaN where there are none
    width: float  # Standard deviation of their distances to the nearest map points
    directions: tuple[Direction, ...]  # The six motions, the weakest first


def frame_verdict(evidence: FrameEvidence, notes: tuple[Reason, ...]) -> Verdict:
    """Level and reasons of a frame.

    >>> frame_verdict(FrameEvidence("converged", True, 900.0, 0.9, 0.9, 0.1, ()), ()).level
    'accepted'
    >>> frame_verdict(FrameEvidence("converged", True, 60.0, 0.1, 0.9, 0.1, ()), ()).level
    'failed'
    """
    e = evidence
    if not e.found:
        return Verdict("failed", (Reason(f"no pose: ICP ended with the status {e.status!r}", "no_pose"), *notes))
    if not e.on_map >= LOST:
        words = f"no pose: only {100 * e.on_map:.0f} % of the frame's points are inliers at the best one"
        return Verdict("failed", (Reason(words, "lost"), *notes))
    doubts = [words for words in (_misfit(e.on_map, e.usual),) if words]
    if not e.inliers >= FEWEST_INLIERS:
        words = f"only {e.inliers:.0f} inliers: too few to check the pose"
        doubts.append(Reason(words, "few_inliers"))
    doubts.extend(Reason(d.words, "unconstrained") for d in e.directions if d.is_free)
    if e.status != "converged":
        doubts.append(Reason(f"ICP did not converge: {e.status}", "not_converged"))
    if doubts:
        return Verdict("suspect", (*doubts, *notes))
    words = (
        f"{e.inliers:.0f} inliers, {100 * e.on_map:.0f} % of the frame, with residuals of {e.width:.3g} (one sigma); "
        "all degrees of freedom are constrained"
    )
    return Verdict("accepted", (Reason(words, "accepted"), *notes))


def fits(on_map: float, usual: float) -> bool:
    """Whether so many points of a frame lie on the map that its pose can be believed."""
    return _misfit(on_map, usual) is None


def _misfit(on_map: float, usual: float) -> Reason | None:
    if not on_map >= FEW_ON_MAP:
        return Reason(
            f"only {100 * on_map:.0f} % of the frame's points are inliers: the pose may have slipped",
            "low_inlier_fraction",
        )
    if on_map < FALL * usual:
        return Reason(
            f"{100 * on_map:.0f} % of the frame's points are inliers, after {100 * usual:.0f} % in the frames "
            "before: the pose may have slipped, or the view is new",
            "falling_inlier_fraction",
        )
    return None


def without_pose(reasons: tuple[Reason, ...], status: str, settings: dict[str, object]) -> Registration:
    """Result of a frame that cannot be placed.

    >>> without_pose((Reason("it is empty", "too_few_points"),), "no points", {}).verdict.level
    'failed'
    """
    return _bare(np.full((4, 4), np.nan), Verdict("failed", reasons), status, np.nan, settings)


def first_frame(T_map_frame: FloatArray, notes: tuple[Reason, ...], settings: dict[str, object]) -> Registration:
    """Result of the frame that the map begins with."""
    words = "the first frame: its pose defines the frame of the map"
    verdict = Verdict("accepted", (Reason(words, "first_frame"), *notes))
    return _bare(T_map_frame, verdict, "first frame", 0.0, settings)


def _bare(T: FloatArray, verdict: Verdict, status: str, variance: float, settings: dict[str, object]) -> Registration:
    return Registration(
        T_target_source=T,
        verdict=verdict,
        status=status,
        covariance=np.full((6, 6), variance),
        observability=(),
        alternatives=(),
        history=(),
        rms=np.nan,
        inlier_fraction=np.nan,
        timings={},
        settings=settings,
    )
