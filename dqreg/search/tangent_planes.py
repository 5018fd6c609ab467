"""A cloud as a part: its points with a piece of their tangent planes, so that near symmetries can be asked of it."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry import Closest, CloudSurface, Mesh
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.spacing import measure_spacing
from dqreg.geometry.surface import Hint
from dqreg.rigid import pose
from dqreg.search.symmetry import ON_PART_DIAGONALS

# Points that stand for the cloud, and that check a symmetry.
CLOUD_POINTS, CHECKING_POINTS = 1_500, 4_000
# Edge of a facet, in sizes: none that a distance shows.
FACET_DIAGONALS = 1e-7
# Spacings beside a point up to which the cloud is taken to go on in its tangent plane.
PLANE_REACH_SPACINGS = 4.0
# A motion is a symmetry that leaves so large a share of the flatter half of the points in the planes,
IN_PLACE_SHARE = 0.9
# and hardly a point, no larger share, farther off than so many spacings.
OFF_SPACINGS, MAX_OFF_SHARE = 3.0, 1e-3


class TangentPlanes:
    """A cloud as a surface of tangent planes as wide as its gaps; normals have a sign that the cloud alone decides."""

    def __init__(self, cloud: CloudSurface) -> None:
        self._cloud = cloud
        self.diagonal, self.centre, self.oriented = cloud.diagonal, cloud.centre, True
        self.spacing = measure_spacing(cloud._tree, cloud._points)

    @property
    def has_facets(self) -> bool:
        """Whether some of its points have normals: those of lines have none."""
        return bool(self._cloud._planes_at(self._rows_of_facets())[0].any())

    def _rows_of_facets(self) -> IntArray:
        return sample_rows(len(self._cloud._points), CLOUD_POINTS)

    def facets(self) -> Mesh:
        """Equal triangles, too small to be seen, about some points: a mesh with the cloud's moments and normals."""
        rows = self._rows_of_facets()
        normals = _upward(self._cloud._planes_at(rows)[0])
        rows, normals = rows[normals.any(axis=1)], normals[normals.any(axis=1)]
        points = self._cloud._points[rows]
        one = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
        one *= FACET_DIAGONALS * self.diagonal / np.linalg.norm(one, axis=1, keepdims=True)
        corners = np.stack([points, points + one, points + np.cross(normals, one)], axis=1)
        return Mesh(corners.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3))

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Nearest place of the tangent planes beside the nearest point; that or another one where none is within."""
        reach = float(np.hypot(within, PLANE_REACH_SPACINGS * self.spacing))
        rows, apart = self._cloud._tree.nearest(points, 1, reach)
        rows, apart = np.minimum(rows[:, 0], len(self._cloud._points) - 1), apart[:, 0]
        places, normals = np.take(self._cloud._points, rows, axis=0), _upward(self._cloud._planes_at(rows)[0])
        aside = np.einsum("ij,ij->i", points - places, normals)
        feet = points - aside[:, None] * normals
        beside = np.sqrt(np.maximum(apart**2 - aside**2, 0.0))
        is_beside = (beside <= PLANE_REACH_SPACINGS * self.spacing) & normals.any(axis=1)
        return Closest(
            np.where(is_beside[:, None], feet, places), normals, np.where(is_beside, np.abs(aside), apart), rows
        )

    def is_symmetry(self, T: FloatArray) -> bool:
        """Whether a motion leaves all of the cloud about in place."""
        rows = sample_rows(len(self._cloud._points), CHECKING_POINTS)
        variances = self._cloud._planes_at(rows)[1]
        away = self.closest(pose.apply(T, self._cloud._points[rows])).distances
        is_off = away > max(ON_PART_DIAGONALS * self.diagonal, OFF_SPACINGS * self.spacing)
        # At edges planes are none.
        in_place = away[variances <= np.median(variances)] <= ON_PART_DIAGONALS * self.diagonal
        return bool(np.mean(in_place) >= IN_PLACE_SHARE and np.mean(is_off) <= MAX_OFF_SHARE)

    def on_rim(self, closest: Closest) -> BoolArray:
        """None of it is known."""
        return np.zeros(len(closest.distances), dtype=bool)


def _upward(normals: FloatArray) -> FloatArray:
    """Normals of either sign, (n, 3), with one that parallel ones share."""
    largest = np.abs(normals + 1e-3 * np.array([1.0, 0.5, 0.0])).argmax(axis=1)
    return np.asarray(normals * np.where(normals[np.arange(len(normals)), largest] < 0.0, -1.0, 1.0)[:, None])
