"""Places of two clouds on both sides of a wall: each cloud shows one of them, and neither a face that lies apart.

A place of one cloud beside a point far off on a parallel face of the other one is on a face that moved, or of another
part, or on the other side of a wall. The faces beside both tell: where they are sides of a wall these turn to opposite
ways at the rims that both have, and the same way where one face is at two places.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, median
from dqreg.geometry.normals import sample_rows
from dqreg.rigid import pose
from dqreg.trust.common_planes import TRIED_PLACES, fullest_plane, plane_thickness
from dqreg.trust.face_rims import SAME_RIM_SPACINGS, Faces, Held, Plane, Points
from dqreg.trust.overlap import MIN_COMPARISONS, IndexedPoints, Overlap
from dqreg.trust.turning_rims import Turning, shared_turning

# Distances within which points lie in a plane that a wall is thick at least.
MIN_WALL_THICKNESSES = 2.0
# Places on a wall without which it has no say; walls that are looked for.
MIN_WALL_PLACES, MAX_WALLS = 12, 4
# Share of the rims of both faces beside which the others turn to opposite ways: walls came to 1, faces of other parts
# and of wrong poses to 0.3.
MIN_OPPOSED_SHARE = 0.8


def without_walls(
    overlap: Overlap, moves: IndexedPoints, stands: IndexedPoints, T_target_source: FloatArray, size: float
) -> Overlap:
    """What two clouds of a size show at a pose, (4, 4), without places on both sides of a wall."""
    within = plane_thickness(overlap, size)
    left = np.abs(overlap.residuals) > MIN_WALL_THICKNESSES * within
    if np.count_nonzero(left) < MIN_WALL_PLACES:
        return overlap
    sides = (pose.apply(T_target_source, moves.points), moves.tree), (stands.points, stands.tree)
    on_walls = np.zeros(len(left), dtype=bool)
    for _ in range(MAX_WALLS):
        rows = np.flatnonzero(left)
        if len(rows) < MIN_WALL_PLACES:
            break
        held = fullest_plane(overlap, rows[sample_rows(len(rows), TRIED_PLACES)], left, within)
        left &= ~held
        if _are_a_wall(overlap.at(held), sides, within):
            on_walls |= held
    without = overlap.at(~on_walls)
    return without if np.count_nonzero(without.inner) >= MIN_COMPARISONS else overlap


def _are_a_wall(places: Overlap, sides: tuple[Points, Points], within: float) -> bool:
    """Whether places in one plane are amid two parallel faces, one of each cloud, that are sides of a wall."""
    normal, middle = places.normals[0], np.median(places.points, axis=0)
    # Normals have no sign of their own, and the distances along them have theirs.
    heights = places.residuals * (places.normals @ normal)
    gap = median(heights)
    if np.count_nonzero(np.abs(heights - gap) < within) < MIN_WALL_PLACES:
        return False
    one, other = (
        _turning(side, Plane(middle + offset * normal, normal), offset * normal, within)
        for side, offset in zip(sides, (0.5 * gap, -0.5 * gap), strict=True)
    )
    if one is None or other is None:
        return False
    reach = SAME_RIM_SPACINGS * max(one[1], other[1])
    return shared_turning(one[0], other[0], reach).opposed >= MIN_OPPOSED_SHARE


def _turning(side: Points, plane: Plane, offset: FloatArray, within: float) -> tuple[Turning, float] | None:
    """Rims of a cloud's face in a plane beside which others turn, taken back by an offset, (3,); and its spacing."""
    heights = (side[0] - plane.middle) @ plane.normal
    held = Held.of(side[0], Faces.of(side[1], heights, within), plane, within)
    if held is None:
        return None
    rims = held.rims([plane])
    turning = Turning.of(rims.rows, rims.outward, side, heights, within, rims.spacing)
    return turning._replace(points=turning.points - offset), rims.spacing
