"""Correspondences of one iteration: moved source points and their closest points on the target."""

from __future__ import annotations

import dataclasses
import math
from functools import cached_property

import numpy as np

from dqreg._arrays import FloatArray, IntArray, product
from dqreg._records import remember, remembered
from dqreg.geometry.scan import Scan
from dqreg.geometry.surface import Closest, Surface
from dqreg.geometry.vector_rows import row_dots

# Rows that are moved in one go.
CHUNK_ROWS = 8_192
# No choice of rows.
ALL_ROWS = np.zeros(0, dtype=np.int64)
# Normals farther apart than 125 degrees look the other way.
OPPOSED_COS = -math.cos(math.radians(55.0))


@dataclasses.dataclass(frozen=True)
class Correspondences:
    """Correspondences of a scan at one pose."""

    scan: Scan  # The source, untouched, in its own frame
    T_target_source: FloatArray  # (4, 4): The pose of the search
    closest: Closest  # Closest point on the target for each scan point, in the target frame
    same_sign: bool  # Whether both sides' normals have known signs, so that they may be compared as they are
    surface: Surface | None = None  # The target that was asked, where it is known

    def taken(self, rows: IntArray) -> Correspondences:
        """Those of some rows of the scan alone."""
        closest = self.closest._taken(rows)
        some = Correspondences(self.scan.taken(rows), self.T_target_source, closest, self.same_sign, self.surface)
        moved = remembered(self, "moved")
        return some if moved is None else remember(some, moved=np.take(moved, rows, axis=0))

    @property
    def distances(self) -> FloatArray:
        """Distances, (n,)."""
        return self.closest.distances

    @property
    def squares(self) -> FloatArray:
        """Mean squared distances of the points that each row represents, (n,)."""
        squares: FloatArray = self.closest.distances**2 + self.scan.scatter
        return squares

    @cached_property
    def moved(self) -> FloatArray:
        """Source points at the pose, (n, 3)."""
        return moved_points(self.T_target_source, self.scan.points)

    @cached_property
    def point_to_plane(self) -> FloatArray:
        """Distance of each moved point from the target's tangent plane, positive on the normal's side, (n,)."""
        offsets: FloatArray = row_dots(self.moved - self.closest.points, self.closest.normals)
        return offsets

    @cached_property
    def normal_cosines(self) -> FloatArray:
        """Cosine between the moved source normal and the target normal, (n,); 0 where either is unknown."""
        # One product with the rotated target normals instead of a turn of every source normal.
        back = product(self.closest.normals, self.T_target_source[:3, :3])
        cosines: FloatArray = row_dots(back, self.scan.normals)
        return cosines

    def looking_away(self, reach: float) -> float:
        """Share of the pairs within reach whose normals are opposed; NaN where a side of them is not known."""
        near = self.distances <= reach
        if not self.same_sign or not near.any():
            return math.nan
        return float(np.mean(self.normal_cosines[near] < OPPOSED_COS))

    @cached_property
    def source_directions(self) -> FloatArray:
        """Source normals with the sign that agrees with the target's, (n, 3)."""
        if self.same_sign:
            return self.scan.normals
        return self.scan.normals * np.where(self.normal_cosines < 0.0, -1.0, 1.0)[:, None]


def find_correspondences(
    scan: Scan, surface: Surface, T_target_source: FloatArray, before: Correspondences | None = None
) -> Correspondences:
    """Closest point on the surface for every scan point."""
    if before is not None and before.scan is scan and np.array_equal(before.T_target_source, T_target_source):
        return before
    moved = moved_points(T_target_source, scan.points)
    closest = surface.closest(moved, None if before is None else (before.moved, before.closest))
    found = Correspondences(scan, T_target_source, closest, scan.oriented and surface.oriented, surface)
    return remember(found, moved=moved)


def moved_points(T_target_source: FloatArray, points: FloatArray) -> FloatArray:
    """Points at a pose, (n, 3), on all threads."""
    from dqreg.kernels.steps.weighing import move_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    moved = np.zeros(points.shape)
    over_chunks(move_rows, len(points), as_plain(points), as_plain(T_target_source), moved, chunk=CHUNK_ROWS)
    return moved


def propagate(pairs: Correspondences, T_target_source: FloatArray) -> Correspondences:
    """Correspondences at a nearby pose without another search: each target point slides on its tangent plane.

    On a face that is what it does, and between the points of a cloud it leaves the gaps as wide as they were.
    """
    found = pairs.closest
    moved, points, distances = _slid(T_target_source, pairs.scan.points, pairs.moved, found.points, found.normals)
    closest = Closest(points, found.normals, distances, found.elements, None, found.variances)
    slid = Correspondences(pairs.scan, T_target_source, closest, pairs.same_sign, pairs.surface)
    return remember(slid, moved=moved)


def slid_distances(pairs: Correspondences, T_target_source: FloatArray, rows: IntArray = ALL_ROWS) -> FloatArray:
    """Distances of some rows of the same, (m,), or of all."""
    found, columns = pairs.closest, (pairs.scan.points, pairs.moved)
    return _slid(T_target_source, *columns, found.points, found.normals, rows, kept=0)[2]


def _slid(
    T_target_source: FloatArray,
    points: FloatArray,
    before: FloatArray,
    feet: FloatArray,
    normals: FloatArray,
    rows: IntArray = ALL_ROWS,
    *,
    kept: int | None = None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Some points at the pose and their feet, slid from where they were before, (m, 3), and their distances, (m,).

    Of the first two all are kept or, with zero, none.
    """
    from dqreg.kernels.steps.weighing import slide_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    count = len(rows) or len(points)
    moved, slid = np.zeros((2, count if kept is None else kept, 3))
    distances = np.zeros(count)
    columns = points, T_target_source, before, feet, normals
    over_chunks(slide_rows, count, *map(as_plain, columns), rows, moved, slid, distances, chunk=CHUNK_ROWS)
    return moved, slid, distances


def placed(pairs: Correspondences, T_target_source: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points of correspondences at a pose near by, (n, 3), and their heights over the planes found before, (n,)."""
    from dqreg.kernels.steps.weighing import place_rows
    from dqreg.kernels.threads import as_plain, over_chunks

    count = len(pairs.scan)
    moved, heights = np.zeros((count, 3)), np.zeros(count)
    columns = pairs.scan.points, T_target_source, pairs.closest.points, pairs.closest.normals
    over_chunks(place_rows, count, *map(as_plain, columns), moved, heights, chunk=CHUNK_ROWS)
    return moved, heights
