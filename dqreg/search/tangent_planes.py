"""A cloud as a part: its points with a piece of their tangent planes, so that near symmetries can be asked of it."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry import Closest, CloudSurface, Mesh
from dqreg.geometry.distinct_points import DistinctPoints
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
        self._cloud: DistinctPoints = cloud._distinct
        self.diagonal, self.centre, self.oriented = cloud.diagonal, cloud.centre, True
        self.spacing = self._cloud.spacing

    @property
    def has_facets(self) -> bool:
        """Whether some of its points have normals: those of lines have none."""
        return bool(self._cloud.sampled(CLOUD_POINTS)[1].any())

    def facets(self) -> Mesh:
        """Equal triangles, too small to be seen, about some points: a mesh with the cloud's moments and normals."""
        points, normals, _ = self._cloud.sampled(CLOUD_POINTS)
        normals, has_normal = _upward(normals), normals.any(axis=1)
        points, normals = points[has_normal], normals[has_normal]
        one = np.cross(normals, np.eye(3)[np.abs(normals).argmin(axis=1)])
        one *= FACET_DIAGONALS * self.diagonal / np.linalg.norm(one, axis=1, keepdims=True)
        corners = np.stack([points, points + one, points + np.cross(normals, one)], axis=1)
        return Mesh(corners.reshape(-1, 3), np.arange(3 * len(points)).reshape(-1, 3))

    def closest(self, points: FloatArray, hint: Hint | None = None, within: float = np.inf) -> Closest:
        """Nearest place of the tangent planes beside the nearest point; that or another one where none is within."""
        reach = float(np.hypot(within, PLANE_REACH_SPACINGS * self.spacing))
        rows, apart = self._cloud.tree.nearest(points, 1, reach)
        rows, apart = np.minimum(rows[:, 0], len(self._cloud) - 1), apart[:, 0]
        places, normals = np.take(self._cloud.points, rows, axis=0), _upward(self._cloud.planes_at(rows)[0])
        aside = np.einsum("ij,ij->i", points - places, normals)
        feet = points - aside[:, None] * normals
        beside = np.sqrt(np.maximum(apart**2 - aside**2, 0.0))
        is_beside = (beside <= PLANE_REACH_SPACINGS * self.spacing) & normals.any(axis=1)
        return Closest(
            np.where(is_beside[:, None], feet, places), normals, np.where(is_beside, np.abs(aside), apart), rows
        )

    def is_symmetry(self, T: FloatArray) -> bool:
        """Whether a motion leaves all of the cloud about in place."""
        points, _, variances = self._cloud.sampled(CHECKING_POINTS)
        away = self.closest(pose.apply(T, points)).distances
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
