"""How much of each face of a part a scan covers: what was not measured."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Mesh
from dqreg.geometry.mesh_faces import triangle_areas

# A place of a face is covered where a scan point of that face lies within so many usual spacings: of points that are
# spread at random over a face, 0.0004 % of the places have none.
NEAR = 2.0
# Places that are asked on each face, and on all.
PLACES, MOST = 400, 400_000
# The plastic number's powers: steps that fill a square evenly.
STEPS = np.array([0.7548776662466927, 0.5698402909980532])


@dataclasses.dataclass(frozen=True)
class FaceCoverage:
    """How much of a face was scanned.

    Attributes
    ----------
    face : int
        Its number.
    kind : str
        Its shape.
    area : float
        Target units, squared.
    points : int
        Scan points on it.
    share : float
        Share of its area that has scan points within two usual spacings.
    used : bool
        Whether the plan names it.
    """

    face: int
    kind: str
    area: float
    points: int
    share: float
    used: bool


def covered(mesh: Mesh, of_triangle: IntArray, points: FloatArray, on: IntArray, density: float) -> FloatArray:
    """Share of each face's area that scan points cover. Shapes: (f,), (n, 3), (n,); returns (faces,).

    ``on`` is the face of each point; ``density`` is the usual number of points for an area.
    """
    from scipy.spatial import cKDTree

    count = int(of_triangle.max()) + 1 if len(of_triangle) else 0
    if not len(points) or not density > 0.0:
        return np.zeros(count)
    each = max(1, min(PLACES, MOST // max(count, 1)))
    places = _places(mesh, of_triangle, count, each)
    reach = NEAR / math.sqrt(density)
    # Faces lie apart in a fourth direction: a point on the other side of a thin sheet covers nothing here.
    apart = 2.0 * reach
    tree = cKDTree(np.column_stack([points, apart * on]))
    asked = np.column_stack([places, apart * np.repeat(np.arange(count), each)])
    gaps = tree.query(asked, distance_upper_bound=reach)[0]
    shares: FloatArray = np.isfinite(gaps).reshape(count, each).mean(axis=1)
    return shares


def _places(mesh: Mesh, of_triangle: IntArray, count: int, each: int) -> FloatArray:
    """Places spread evenly over every face, the same for the same mesh: (count * each, 3)."""
    order = np.argsort(of_triangle, kind="stable")
    areas = triangle_areas(mesh)[order]
    ends = np.cumsum(areas)
    first, last = (np.searchsorted(of_triangle[order], np.arange(count), side=side) for side in ("left", "right"))
    high = ends[last - 1]
    low = np.concatenate([[0.0], high[:-1]])
    at = low[:, None] + (high - low)[:, None] * (np.arange(each) + 0.5) / each
    rows = np.clip(np.searchsorted(ends, at), first[:, None], last[:, None] - 1)
    a, b, c = np.moveaxis(mesh.corners[order[rows.ravel()]], 1, 0)
    u, v = (((0.5 + np.arange(count * each)[:, None] * STEPS) % 1.0).T)[:, :, None]
    root = np.sqrt(u)
    found: FloatArray = (1.0 - root) * a + root * (1.0 - v) * b + root * v * c
    return found
