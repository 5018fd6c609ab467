"""How much of each face of a part a scan covers: what was not measured."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Mesh
from dqreg.geometry.mesh_faces import areas_of, triangle_areas

# A place of a face is covered where a scan point of that face lies within so many usual spacings: of points that are
# spread at random over a face, 0.0004 % of the places have none.
COVERING_SPACINGS = 2.0
# Places that are asked on each face, and on all.
PLACES_PER_FACE, MAX_PLACES = 400, 400_000
# Points that are looked at for the share of a whole part: more say the same.
LOOKED_AT = 200_000
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
    count = int(of_triangle.max()) + 1 if len(of_triangle) else 0
    if not len(points) or not density > 0.0:
        return np.zeros(count)
    shares: FloatArray = covered_places(mesh, of_triangle, points, on, density)[2].reshape(count, -1).mean(axis=1)
    return shares


def covered_places(
    mesh: Mesh, of_triangle: IntArray, points: FloatArray, on: IntArray, density: float
) -> tuple[FloatArray, IntArray, BoolArray]:
    """Places spread evenly over every face, as many on each; their triangles; whether scan points cover them."""
    from scipy.spatial import cKDTree

    count = int(of_triangle.max()) + 1
    each = max(1, min(PLACES_PER_FACE, MAX_PLACES // count))
    places, triangles = _places(mesh, of_triangle, count, each)
    reach = COVERING_SPACINGS / math.sqrt(density)
    # Faces lie apart in a fourth direction: a point on the other side of a thin sheet covers nothing here.
    apart = 2.0 * reach
    tree = cKDTree(np.column_stack([points, apart * on]))
    asked = np.column_stack([places, apart * np.repeat(np.arange(count), each)])
    gaps = tree.query(asked, distance_upper_bound=reach)[0]
    return places, triangles, np.isfinite(gaps)


def scanned_share(mesh: Mesh, of_triangle: IntArray, points: FloatArray, on: IntArray) -> float:
    """Share of a part's area that scan points cover. Shapes: (f,), (n, 3), (n,); ``on`` is the face of each point."""
    if not len(points):
        return 0.0
    step = -(-len(points) // LOOKED_AT)
    points, on = points[::step], on[::step]
    areas = areas_of(mesh, of_triangle)
    shares = covered(mesh, of_triangle, points, on, usual_density(on, areas))
    return float(shares @ areas / areas.sum())


def usual_density(on: IntArray, areas: FloatArray) -> float:
    """Points for an area on the faces that were scanned, by the points; ``on`` is the face of each."""
    counts = np.bincount(on, minlength=len(areas))
    return weighted_median(counts / np.maximum(areas, 1e-300), counts) if len(on) else 1.0


def weighted_median(values: FloatArray, weights: IntArray) -> float:
    """The value that half of the weight lies below."""
    order = np.argsort(values)
    reached = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(reached, 0.5 * reached[-1])])


def _places(mesh: Mesh, of_triangle: IntArray, count: int, each: int) -> tuple[FloatArray, IntArray]:
    """Places spread evenly over every face, the same for the same mesh, (count * each, 3), and their triangles."""
    order = np.argsort(of_triangle, kind="stable")
    areas = triangle_areas(mesh)[order]
    ends = np.cumsum(areas)
    first, last = (np.searchsorted(of_triangle[order], np.arange(count), side=side) for side in ("left", "right"))
    high = ends[last - 1]
    low = np.concatenate([[0.0], high[:-1]])
    at = low[:, None] + (high - low)[:, None] * (np.arange(each) + 0.5) / each
    rows = np.clip(np.searchsorted(ends, at), first[:, None], last[:, None] - 1)
    triangles = order[rows.ravel()]
    a, b, c = np.moveaxis(mesh.corners[triangles], 1, 0)
    u, v = (((0.5 + np.arange(count * each)[:, None] * STEPS) % 1.0).T)[:, :, None]
    root = np.sqrt(u)
    found: FloatArray = (1.0 - root) * a + root * (1.0 - v) * b + root * v * c
    return found, triangles
