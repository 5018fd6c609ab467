"""Questions of the verdict on other poses: motions that fit better or as well, and how firmly each is held."""

from __future__ import annotations

import math
from collections.abc import Iterator

from dqreg._statuses import Status, is_finished
from dqreg.trust.evidence import Evidence
from dqreg.trust.limits import (
    CONSTRAINT_LOG_LIKELIHOOD,
    FREED_GAIN,
    MAX_SIGMA_DIAGONALS,
    MAX_SIGMA_RAD,
    MIRROR_GAIN,
    counts_all,
    fewest_carriers,
    sigma_limits,
)
from dqreg.trust.question import Question, asks
from dqreg.trust.records import Direction

# What to do about a loop that ended so.
ADVICE: dict[Status, str] = {
    "iteration limit": "; raise max_iterations, or give a closer initial pose",
    "stalled": "; the step size stopped decreasing: check the pose, or give a closer initial pose",
}


@asks(
    "forbidden_motion",
    "Log-likelihood that a motion gains which dof= or prior= forbids",
    "at most",
    "",
    lambda e: (e.freed_gain, FREED_GAIN),
)
def forbidden_motion(evidence: Evidence) -> Iterator[str]:
    """The scan fits better where it may not be."""
    yield (
        f"the scan fits better after a rotation by {math.degrees(evidence.freed_rad):.2g} degrees and a shift by "
        f"{evidence.length(evidence.freed_shift)} of the middle, which dof= or prior= forbids"
    )


def _mirrored(evidence: Evidence) -> tuple[float, float]:
    gain, freed = evidence.mirror_gain, evidence.freed_gain
    # A pose that is held away from its own may gain as much in the mirror.
    return gain, freed if freed >= gain > MIRROR_GAIN else MIRROR_GAIN


@asks("mirrored", "Log-likelihood that mirroring the scan gains", "at most", "", _mirrored)
def mirrored(evidence: Evidence) -> Iterator[str]:
    """The scan's mirror image fits better."""
    # At a wrong scale neither image fits, and either may gain.
    scaled = evidence.stretch and not any(evidence.stretched_along)
    also = "; at another scale this may be otherwise" if scaled else ""
    yield (
        "the scan fits better when mirrored: it shows the part's mirror image, or comes from a left-handed frame" + also
    )


@asks(
    "unconstrained",
    "Unconstrained motions",
    "at most",
    "motions",
    lambda e: (float(sum(direction.is_free for direction in e.directions)), 0.0),
)
def unconstrained(evidence: Evidence) -> Iterator[str]:
    """Motions that no point holds."""
    return (direction.words for direction in evidence.directions if direction.is_free)


def _sigmas(evidence: Evidence) -> list[tuple[float, Direction]]:
    """Standard deviations of the motions, each over the largest that is an answer."""
    most = sigma_limits(evidence.size)
    known = [(d.sigma / most[d.kind], d) for d in evidence.directions if d.kind in most and most[d.kind] > 0.0]
    return [(ratio, direction) for ratio, direction in known if not math.isnan(ratio)]


@asks(
    "large_uncertainty",
    f"Standard deviation against {math.degrees(MAX_SIGMA_RAD):g} degrees or "
    f"{100.0 * MAX_SIGMA_DIAGONALS:g} % of the size",
    "at most",
    "times",
    lambda e: (max((ratio for ratio, _ in _sigmas(e)), default=math.nan), 1.0),
)
def large_uncertainty(evidence: Evidence) -> Iterator[str]:
    """Motions that are held, and hardly known."""
    for ratio, direction in _sigmas(evidence):
        if ratio > 1.0:
            yield (
                f"the pose is uncertain by {evidence.length(direction.sigma)} (one sigma, "
                f"{100 * direction.sigma / evidence.size:.0f} % of the size): {direction.words}"
            )


def _carriers(evidence: Evidence) -> list[tuple[float, Direction]]:
    """Points that constrain each motion that is held at all."""
    held = zip(evidence.carriers, evidence.directions, strict=False)
    return [(carriers, direction) for carriers, direction in held if not (direction.is_free or math.isnan(carriers))]


def _fewest_carriers(evidence: Evidence) -> tuple[float, float]:
    fewest = min((carriers for carriers, _ in _carriers(evidence)), default=math.nan)
    return fewest, fewest_carriers(evidence.inliers, of_both=evidence.carriers_of_both)


def _held_by_few(evidence: Evidence) -> Iterator[str]:
    fewest = fewest_carriers(evidence.inliers, of_both=evidence.carriers_of_both)
    for carriers, direction in _carriers(evidence):
        if carriers < fewest:
            held = f"about {carriers:.0f} points" + (" on which both scans agree" if evidence.carriers_of_both else "")
            yield f"one motion depends on {held}: {direction.words}"


def _sliding(evidence: Evidence) -> tuple[float, float]:
    fewest, enough = _fewest_carriers(evidence)
    loss, limit = evidence.sliding_loss, CONSTRAINT_LOG_LIKELIHOOD
    return loss if fewest < enough or loss >= limit else math.nan, limit


# Asked in place of the number of points where they are few, and shown where rims hold what no point does.
SLIDING = Question(
    "weakly_constrained",
    "Log-likelihood that a displacement along the weakest motion costs",
    "at least",
    "",
    _sliding,
    _held_by_few,
)


@asks(
    "weakly_constrained",
    "Points that constrain the weakest motion",
    "at least",
    "points",
    _fewest_carriers,
    instead=SLIDING,
)
def weakly_constrained(evidence: Evidence) -> Iterator[str]:
    """Motions that depend on few points."""
    return _held_by_few(evidence)


@asks(
    "alternative_poses",
    "Other poses that are equally likely",
    "at most",
    "poses",
    lambda e: (float(len(e._other_poses)), 0.0),
)
def alternative_poses(evidence: Evidence) -> Iterator[str]:
    """Other poses fit as well, and no symmetry of the part leads to them."""
    others = evidence._other_poses
    some = "another pose is" if len(others) == 1 else f"{len(others)} other poses are"
    where = f"; the scan fits as well {others[0].words}" if others[0].words else ""
    remedy = "; with prediction=, or stamp= and no long gap, the motion decides" if counts_all(evidence) else ""
    yield f"{some} equally likely: see alternatives{where}{remedy}"


@asks(
    "search_time_limit",
    "The global search was finished",
    "at most",
    "",
    lambda e: (float(not is_finished(e.search)), 0.0),
    yes_or_no=True,
)
def search_time_limit(evidence: Evidence) -> Iterator[str]:
    """The search was ended by the time limit."""
    yield (
        f'the time limit ended the global search after its stage "{evidence.search}": its poses were not compared; '
        "allow more time, or give an initial pose"
    )


@asks("not_converged", "ICP converged", "at most", "", lambda e: (float(e.status != "converged"), 0.0), yes_or_no=True)
def not_converged(evidence: Evidence) -> Iterator[str]:
    """The loop ended before it converged."""
    advice = "" if counts_all(evidence) else ADVICE.get(evidence.status, "")
    yield f"ICP did not converge: {evidence.status}{advice}"
