"""One scale followed to where it leads: refined together with its pose, and judged there by the likelihood.

Distances are compared in the *source's* own unit, where the noise does not change with the scale: in the target's unit
the smallest copy would always fit best.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import partial

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.beginning import Searching
from dqreg.errors import DegenerateGeometryError
from dqreg.geometry import Surface
from dqreg.geometry.prepare import Scan
from dqreg.icp import COARSE, InlierMixture, Pairs, correspond, width_floor
from dqreg.rigid import pose
from dqreg.solvers.scale import ScaleStep, SurfaceMatches, robust_weights, scale_step

# Steps of the joint refinement at most; the largest change of scale in one of them; the change that is none.
STEPS, LARGEST, STILL = 40, 1.03, 1e-6


@dataclasses.dataclass(frozen=True)
class ScaleCandidate:
    """A scale, its pose, and how badly both explain the scan."""

    scale: float  # What the source, in the unit it is worked with, is multiplied with
    T_work: FloatArray  # (4, 4): Pose of the scaled source between the centred frames
    surprise: float  # Mean negative log-likelihood of the distances in source units; the lower the better
    held: bool  # Whether the matches fix the scale
    width: float = np.inf  # Width of the inliers' distances, source units
    share: float = 0.0  # Share of inliers among all points


def scaled(scan: Scan, scale: float) -> Scan:
    """A scan in another unit."""
    return dataclasses.replace(
        scan,
        points=scale * scan.points,
        levers=scale**2 * scan.levers,
        residuals=scale * scan.residuals,
        spacing=scale * scan.spacing,
        noise=scale * scan.noise,
    )


def joint_step(
    scan: Scan,
    surface: Surface,
    scale: float,
    T_work: FloatArray,
    weigh: Callable[[Pairs], FloatArray],
    *,
    hold: bool = False,
) -> ScaleStep:
    """One step of scale and pose together, from the closest places of a scaled scan."""
    pairs = correspond(scaled(scan, scale), surface, T_work)
    matches = SurfaceMatches(pairs.moved, pairs.closest.points, pairs.closest.normals, weigh(pairs))
    return scale_step(matches, hold=hold)


def refine_scale(searching: Searching, scale: float, T_work: FloatArray, *, hold: bool = False) -> ScaleCandidate:
    """Scale and pose together, on a few thousand points."""
    surface = searching.target.indexed.surface
    few = searching.scan.thinned(COARSE)
    floor, held = width_floor(few, surface), True
    for _ in range(STEPS):
        try:
            step = joint_step(few, surface, scale, T_work, partial(_robust, floor=scale * floor), hold=hold or not held)
        except DegenerateGeometryError:
            if not held:
                break
            held = False
            continue
        if not 1.0 / LARGEST <= step.factor <= LARGEST:
            step = dataclasses.replace(step, factor=float(np.clip(step.factor, 1.0 / LARGEST, LARGEST)))
        before, T_work, scale = T_work, step.moved(T_work), scale * step.factor
        moved = float(pose.offset_between(before, T_work)) + float(pose.angle_between(before, T_work)) * few.diagonal
        if abs(np.log(step.factor)) <= STILL and moved <= STILL * surface.diagonal:
            break
    return _judged(searching, few, ScaleCandidate(scale, T_work, np.inf, held and not hold), floor)


def _robust(pairs: Pairs, floor: float) -> FloatArray:
    return robust_weights(pairs.distances, floor)


def _judged(searching: Searching, few: Scan, found: ScaleCandidate, floor: float) -> ScaleCandidate:
    surface, limit = searching.target.indexed.surface, searching.reach
    distances = correspond(scaled(few, found.scale), surface, found.T_work).distances / found.scale
    near = distances[distances <= limit]
    if not len(near):
        return found
    mixture = InlierMixture(max(0.5 * limit, floor), 0.5, limit).learned(near, floor=floor, rounds=100)
    surprise = mixture.surprise(near, rejected=len(distances) - len(near))
    return dataclasses.replace(
        found, surprise=surprise, width=mixture.scale, share=mixture.share * len(near) / len(distances)
    )
