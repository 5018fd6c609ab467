"""The steps of a turntable as a prior of the joint refinement: they hold what no face of a view does.

A view of a plate's edge, or of one face alone, can slide along it by many times what the others are known to, and no
refinement of its points can tell. Where the views that faces hold stand in equal steps, it most likely does so too: as
closely as these scatter, measured without the prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.multiway.pose_graph.graph import PoseGraph
from dqreg.multiway.pose_graph.loops import CHI2_LIMIT
from dqreg.rigid import pose

# Rounds of the mean step; share of the steps that must agree.
MEAN_ROUNDS, MIN_AGREEING_SHARE = 5, 0.5
# Steps, at least, in all and in the better constrained half.
MIN_STEPS, MIN_FIRM_STEPS = 8, 6
# Medians of the sums of one, two and three squares of unit variance; and the scatter of a variance that follows from
# one, in that of the mean of squares.
MEDIANS_OF_SQUARES, MEDIAN_SCATTER_RATIO = (0.455, 1.386, 2.366), 1.6
# Places err, and not steps: of one between two others by half as much again as two steps that err by themselves say.
PLACE_VARIANCE_RATIO = 1.5
# Least variance, of rounding; and largest standard deviation of a step, which is none beyond it.
MIN_VARIANCE, MAX_STEP_SIGMA = 1e-14, 0.02


def step_prior(
    T: FloatArray, covariance: FloatArray, free: IntArray, origins: FloatArray, places: Sequence[int], count: int
) -> PoseGraph | None:
    """Equal steps between bodies at places of a table one after the other; None where most steps do not agree.

    Shapes: T (n, 4, 4), of the centred frames, whose origins (n, 3) are; covariance of the free ones about the world's
    origin, (6 k, 6 k). Lengths are in sizes of a scan; count is of the places all the way round.
    """
    order = np.argsort(places)
    ends = [(i, j) for i, j in pairwise(order.tolist()) if places[j] - places[i] == 1]
    if places[order[-1]] - places[order[0]] == count - 1 > 1:
        ends.append((int(order[-1]), int(order[0])))
    if len(ends) < MIN_STEPS:
        return None
    targets, sources = np.array(ends).T
    # All scans are in one frame, the scanner's: about one middle of all of them.
    aside = pose.from_parts(np.eye(3), origins - origins.mean(axis=0))
    there = T @ pose.inverse(aside)
    motions = pose.inverse(there[targets]) @ there[sources]
    spread = _between(covariance, free, there, targets, sources)
    found = _mean_step(motions, spread)
    if found is None:
        return None
    step, errs, kept = found
    targets, sources = targets[kept], sources[kept]
    measured = pose.inverse(aside[targets]) @ step @ aside[sources]
    information = np.tile(np.linalg.inv(errs), (len(targets), 1, 1))
    return PoseGraph(len(T), targets, sources, measured, information, origins.mean(axis=0) - origins[targets])


def _between(covariance: FloatArray, free: IntArray, T: FloatArray, targets: IntArray, sources: IntArray) -> FloatArray:
    """Covariances of the motions from one body to the next, in the frame of the first, (m, 6, 6)."""
    whole = np.zeros((6 * len(T), 6 * len(T)))
    rows = (6 * free[:, None] + np.arange(6)).ravel()
    whole[np.ix_(rows, rows)] = covariance
    blocks = whole.reshape(len(T), 6, len(T), 6).transpose(0, 2, 1, 3)
    apart = blocks[targets, targets] + blocks[sources, sources] - blocks[targets, sources] - blocks[sources, targets]
    inward = pose.adjoint(pose.inverse(T[targets]))
    return np.asarray(inward @ apart @ inward.transpose(0, 2, 1))


def _mean_step(motions: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray, IntArray] | None:
    """The step, how one errs about it, (6, 6), and which motions agree with it; None where most do not."""
    apart = np.array([np.median(_lengths(pose.log(motions @ pose.inverse(motion)))) for motion in motions])
    step, kept, errs = motions[int(apart.argmin())], np.arange(len(motions)), np.eye(6)
    traces = np.trace(spread, axis1=1, axis2=2)
    firm = np.argsort(traces, kind="stable")[: max(MIN_FIRM_STEPS, len(motions) // 2)]
    for _ in range(MEAN_ROUNDS):
        twists = pose.log(motions @ pose.inverse(step))
        errs = _errors(twists[firm], spread[firm], pose.log(step))
        weights = np.linalg.inv(spread + errs)
        chi2 = np.einsum("mi,mij,mj->m", twists, weights, twists)
        kept = np.flatnonzero(chi2 <= CHI2_LIMIT)
        if len(kept) < MIN_AGREEING_SHARE * len(motions) or np.linalg.eigvalsh(errs)[-1] > MAX_STEP_SIGMA**2:
            return None
        pull = np.einsum("mij,mj->i", weights[kept], twists[kept])
        step = pose.exp(np.linalg.solve(weights[kept].sum(axis=0), pull)) @ step
    # Of so many steps the mean errs too.
    return step, (1.0 + 1.0 / len(firm)) * errs, kept


def _errors(twists: FloatArray, spread: FloatArray, screw: FloatArray) -> FloatArray:
    """Covariance of a step: of its angle, and of all else alike in each direction, without what the poses err by."""
    screw = screw / np.linalg.norm(screw[:3])
    axis = screw[:3]
    angles = twists[:, :3] @ axis
    rest = twists - angles[:, None] * screw
    along = np.einsum("i,mij,j->m", axis, spread[:, :3, :3], axis)
    turns, shifts = (np.trace(spread[:, rows, rows], axis1=1, axis2=2) for rows in (slice(3), slice(3, 6)))
    found = [
        _variance((values**2).sum(axis=1), float(np.median(known)) / dimensions, dimensions)
        for dimensions, values, known in (
            (1, angles[:, None], along),
            (2, rest[:, :3], turns - along),
            (3, rest[:, 3:], shifts),
        )
    ]
    return np.asarray(np.diag(np.repeat(found[1:], 3)) + found[0] * np.outer(screw, screw))


def _variance(squares: FloatArray, known: float, dimensions: int) -> float:
    """Variance along one axis that is left of squared lengths, with a standard error of it."""
    whole = float(np.median(squares)) / MEDIANS_OF_SQUARES[dimensions - 1]
    error = MEDIAN_SCATTER_RATIO * np.sqrt(2.0 / (dimensions * len(squares)))
    return float(PLACE_VARIANCE_RATIO * max(max(whole - known, 0.0) + error * whole, MIN_VARIANCE))


def _lengths(twists: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(twists[:, :3], axis=1) + np.linalg.norm(twists[:, 3:], axis=1))
