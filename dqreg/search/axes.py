"""A start from nothing: centre on centre and principal axes on principal axes, in all 24 proper turns.

It needs a scan that shows enough of the part for its axes to mean something; a scan of one side, or of a scene, does
not: those are for `dqreg.search.pairs`.
"""

from __future__ import annotations

import itertools

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud, Scan
from dqreg.rigid import pose


def propose_turns(scan: Scan, target: PointCloud | Mesh) -> list[FloatArray]:
    """Start poses that put centre on centre and principal axes on principal axes."""
    source_mean, source_axes = principal_axes(*moments(scan))
    target_mean, target_axes = principal_axes(*moments(target))
    poses = []
    for turn in proper_turns():
        R = target_axes @ turn @ source_axes.T
        poses.append(pose.from_parts(R, target_mean - R @ source_mean))
    return poses


def proper_turns() -> list[FloatArray]:
    """The 24 rotations that map the coordinate axes onto each other, (3, 3) each."""
    turns = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            R = np.eye(3)[list(order)] * np.array(signs)
            if np.linalg.det(R) > 0.0:
                turns.append(R)
    return turns


def principal_axes(mean: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and right-handed principal axes, one a column, of a distribution.

    Shapes: covariance (3, 3), axes (3, 3).
    """
    _, axes = np.linalg.eigh(covariance)
    axes[:, 2] *= np.sign(np.linalg.det(axes))
    return mean, axes


def moments(shape: Scan | PointCloud | Mesh) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance of a shape: exact for the surface of a mesh, of the points of a cloud.

    Shapes: covariance (3, 3).
    """
    if isinstance(shape, Mesh):
        # Exact moments of the surface: a triangle's second moment is a twelfth of its corners' scatter.
        weights = shape.face_areas / shape.face_areas.sum()
        centres = shape.corners.mean(axis=1)
        spread = shape.corners - centres[:, None, :]
        mean = weights @ centres
        within = np.einsum("f,fki,fkj->ij", weights, spread, spread) / 12.0
        between = (centres - mean).T @ ((centres - mean) * weights[:, None])
        return mean, within + between
    return shape.points.mean(axis=0), np.cov(shape.points.T)
