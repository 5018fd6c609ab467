"""Covariance of a fitted shape: from the scatter of its residuals between patches, where there are enough of them."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.morton import morton_order
from dqreg.inspection.features.models import FeatureKind, Shape
from dqreg.solvers.sandwich import scatter_of

# Points from which on neighbours' residuals are compared: form error makes them alike.
PATCHWISE = 400


def covariance_of(
    kind: FeatureKind, shape: Shape, points: FloatArray, rows: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Of the parameters, (k, k). Shapes: points (n, 3), rows (r,), slopes (r, k).

    Form error is common to neighbouring points: taken as independent, a thousand of them would make it vanish.
    """
    freedom = max(len(rows) - slopes.shape[1], 1)
    variance = float(rows @ rows) / freedom
    spread = None
    if len(points) >= PATCHWISE and len(rows) == len(points):
        order = morton_order(points)
        none = np.zeros((slopes.shape[1],) * 2)
        # Scaled, so that parameters of any unit stand beside each other.
        scale = np.linalg.norm(slopes, axis=0)
        outward = normals_of(kind, shape, points)[order]
        spread = scatter_of(
            (slopes / scale)[order].T, points[order], outward, rows[order], np.ones(len(points)), none, variance
        )
        spread = None if spread is None else spread / scale / scale[:, None]
    if spread is None:
        spread = np.linalg.pinv(slopes.T @ slopes) * variance
    covariance: FloatArray = 0.5 * (spread + spread.T)
    return covariance


def normals_of(kind: FeatureKind, shape: Shape, points: FloatArray) -> FloatArray:
    """Unit normals of a shape beside points, away from its axis or centre, (n, 3)."""
    if kind == "plane":
        return np.broadcast_to(shape.axis, points.shape)
    offsets = points - shape.point
    if kind == "slot":
        x = shape.frame[:, 0]
        offsets = offsets - np.clip(offsets @ x, -shape.half_length, shape.half_length)[:, None] * x
    if kind != "sphere":
        offsets = offsets - (offsets @ shape.axis)[:, None] * shape.axis
    outward: FloatArray = offsets / np.maximum(np.linalg.norm(offsets, axis=1), 1e-300)[:, None]
    if kind == "cone":
        outward = np.cos(shape.half_angle) * outward - np.sin(shape.half_angle) * shape.axis
    return outward
