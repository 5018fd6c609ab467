"""Motions that are held one way alone, or less than the points near by say: what the scan loses along them tells.

Noise carries points over the rim of a plate, whose sides then keep it from sliding out there; nothing keeps it from
sliding back, until the other rim. And on a thread whose flanks are as near as the noise is large, points find the next
flank where the pose leaves theirs. An information is a curvature at the pose, and sees neither.
"""

from __future__ import annotations

import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.registration.fit.fit import Fit
from dqreg.registration.other_poses.rivals import JUDGING_POINTS
from dqreg.registration.other_poses.slides import CHANCE_SIGMAS, losses_and_scatter
from dqreg.rigid import twist
from dqreg.rigid.twist import scaling_by
from dqreg.trust import Information
from dqreg.trust.covariance import FEW
from dqreg.trust.limits import CONSTRAINT_LOG_LIKELIHOOD

# Motions are asked that fewer points hold than a share of the inliers, or that have less information than this.
MAX_INFORMATION = 1e-3
# A displacement by so many standard deviations has to cost the log-likelihood that holds a motion: under normal noise
# it costs four times as much.
ASKED_SIGMAS = 2.0 * math.sqrt(2.0 * CONSTRAINT_LOG_LIKELIHOOD)
# The farthest displacement that is tried, in sizes.
FARTHEST_DIAGONALS = 0.1


def held_both_ways(fit: Fit, known: Information, scatter: FloatArray) -> FloatArray:
    """The covariance of the scaled twist, (6, 6), wider along weak motions that cost less than it says, either way."""
    if fit.between_clouds or fit.constraints.any or fit.is_late or fit.problem.watch.is_over:
        return scatter
    sigmas = np.sqrt(np.maximum(np.einsum("ij,ik,kj->j", known.vectors, scatter, known.vectors), 0.0))
    for k in np.flatnonzero(_is_weak(known)):
        reached = _reach(fit, known, int(k), float(sigmas[k]))
        if reached > sigmas[k]:
            scatter = scatter + (reached**2 - sigmas[k] ** 2) * np.outer(known.vectors[:, k], known.vectors[:, k])
    return scatter


def _is_weak(known: Information) -> BoolArray:
    few = known.carriers < FEW * known.weight
    return np.asarray(~known.free & ~known.beforehand & (few | (known.values < MAX_INFORMATION)))


def _reach(fit: Fit, known: Information, k: int, sigma: float) -> float:
    """Standard deviation of one motion as all points tell it, a displacement; zero where they do not contradict."""
    size, width = fit.prepared.surface.diagonal, max(fit.run.mixture.scale, fit.floor)
    motion = known.vectors[:, k] / scaling_by(known.lever)
    # As the points tell that are asked, of the usual width each.
    asked = min(known.weight, float(JUDGING_POINTS))
    least = max(sigma, width / math.sqrt(asked * float(known.values[k])))

    def losses(steps: FloatArray) -> FloatArray:
        # Of either way, (2, m).
        ways = [twist.exp(way * step * motion) @ fit.T_target_source for way in (1.0, -1.0) for step in steps]
        lost, scatter = losses_and_scatter(fit, np.stack([fit.T_target_source, *ways]))
        # Of all displacements the steps have found the one that most outliers lie on by chance.
        return (lost - CHANCE_SIGMAS * scatter).reshape(2, -1)

    first, farthest = ASKED_SIGMAS * least, FARTHEST_DIAGONALS * size
    if first >= farthest or losses(np.array([first])).min() >= CONSTRAINT_LOG_LIKELIHOOD:
        return 0.0
    steps = np.array([first * 2.0**k for k in range(1 + math.ceil(math.log2(farthest / first)))])
    # What costs too little: the rim on the other side may be the last that does.
    loose = np.flatnonzero((losses(steps) < CONSTRAINT_LOG_LIKELIHOOD).any(axis=0))
    return 0.5 * float(steps[min(int(loose[-1]) + 1, len(steps) - 1)]) if len(loose) else 0.0
