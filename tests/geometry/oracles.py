"""Slow and obvious answers to compare with: every query against every triangle, in float64."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def brute_triangles(corners: FloatArray, queries: FloatArray) -> FloatArray:
    """Closest points on a soup of triangles, (f, 3, 3), for each query: Gram matrix for the plane, clamps for sides."""
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    rel = queries[:, None] - a
    aa, bb, cc = ((ab * ab).sum(-1), (ab * ac).sum(-1), (ac * ac).sum(-1))
    pb, pc = ((rel * ab).sum(-1), (rel * ac).sum(-1))
    det = aa * cc - bb * bb
    with np.errstate(divide="ignore", invalid="ignore"):
        # Of a needle the determinant may be nothing: there its sides answer.
        v, w = (cc * pb - bb * pc) / det, (aa * pc - bb * pb) / det
        inside = (v >= 0.0) & (w >= 0.0) & (v + w <= 1.0)
    v, w = np.where(inside, v, 0.0), np.where(inside, w, 0.0)
    choices = [np.where(inside[..., None], a + v[..., None] * ab + w[..., None] * ac, np.inf)]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        start, side = corners[:, i], corners[:, j] - corners[:, i]
        share = ((queries[:, None] - start) * side).sum(-1) / (side * side).sum(-1)
        choices.append(start + np.clip(share, 0.0, 1.0)[..., None] * side)
    places = np.concatenate(choices, axis=1)
    best = np.linalg.norm(places - queries[:, None], axis=2).argmin(axis=1)
    return places[np.arange(len(queries)), best]


def brute_points(points: FloatArray, queries: FloatArray) -> FloatArray:
    """Nearest of the points for each query."""
    return points[np.linalg.norm(points - queries[:, None], axis=2).argmin(axis=1)]
