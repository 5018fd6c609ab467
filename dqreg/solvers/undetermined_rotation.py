"""Why matches leave the rotation undetermined, and what mends it: one sentence for each cause."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import DegenerateGeometryError
from dqreg.solvers.matches import Matches
from dqreg.solvers.moments import Moments, sums_of
from dqreg.solvers.narrow_data import NARROW_RATIO

# Distance from the origin, in extents of the points, from which on rounding of the coordinates is the cause. Sums that
# are not about the means meet it at the square root.
FAR_EXTENTS, FAR_UNCENTRED_EXTENTS = 1e8, 1e5
# Singular values that cancel to this fraction: two rotations fit alike.
CANCELLED_RATIO = 1e-6


def no_weight_message() -> str:
    """Message where no point carries weight, so that the translation is undetermined."""
    return (
        "no matched point carries weight, so the translation is not determined (relative gap: none); "
        "directions fix the rotation only: use dqreg.solvers.solve_rotation, or add at least one point of positive "
        "weight"
    )


def undetermined(
    words: str, moments: Moments | None = None, matches: Matches | None = None, *, centred: bool = True
) -> DegenerateGeometryError:
    """Error with the measured gap, the cause and the remedy."""
    if matches is not None:
        moments = sums_of(matches)
    far = FAR_EXTENTS if centred else FAR_UNCENTRED_EXTENTS
    cause = "" if moments is None else f". {_cause(moments, matches, far)}"
    return DegenerateGeometryError(f"the matches do not determine the rotation: {words}{cause}")


def _cause(moments: Moments, matches: Matches | None, far: float) -> str:
    away, extent = _placement(moments, matches)
    if extent > 0.0 and away > far * extent:
        return (
            f"The points lie {away:.3g} from the origin and extend over {extent:.3g} only: there the rounding of "
            "coordinates, or of their squares, is as large as what would fix the rotation. Subtract a common offset "
            "from each side, where the coordinates are made"
        )
    if matches is not None and (few := _too_few(matches)):
        return few
    s1, s2, s3 = _singular_values(moments.point_cross + moments.direction_cross)
    if s2 > NARROW_RATIO * s1 and s3 < 0.0 and s2 + s3 <= CANCELLED_RATIO * s2:
        return (
            "Two rotations fit alike, as where one side is a mirror image of the other or directions are reversed: "
            "check the handedness and the order of the axes, and the signs of normals"
        )
    if matches is not None and (light := _too_light(matches)):
        return light
    if not moments.point_weight > 0.0:
        return "All directions are parallel: add one across them"
    if extent == 0.0:
        return "All points of one side lie in one place: add points elsewhere, or two directions that are not parallel"
    if s2 <= NARROW_RATIO * s1:
        return (
            "All points lie on one line, and no direction across it: add a point off that line or a direction across it"
        )
    return "Points and directions of both sides are not correlated: does row i of one side match row i of the other?"


def _placement(moments: Moments, matches: Matches | None) -> tuple[float, float]:
    """Distance from the origin and extent of the points of the side on which they are smaller, relative to it."""
    found = []
    for side, mean, spread in (
        ("points_source", moments.mean_source, moments.spread_source),
        ("points_target", moments.mean_target, moments.spread_target),
    ):
        away = float(np.linalg.norm(mean))
        if matches is None:
            extent = math.sqrt(spread / moments.point_weight)
        else:
            rows = _heavy(getattr(matches, side), matches.point_weights)
            extent = float(np.ptp(rows, axis=0).max()) if len(rows) else 0.0
        found.append((away, extent))
    return min(found, key=lambda pair: pair[1] / pair[0] if pair[0] > 0.0 else math.inf)


def _heavy(rows: FloatArray, weights: FloatArray | None) -> FloatArray:
    return rows if weights is None else rows[weights > 0.0]


def _too_few(matches: Matches) -> str:
    points = len(_heavy(matches.points_source, matches.point_weights))
    directions = len(_heavy(matches.directions_source, matches.direction_weights))
    # Points count once as a place; each further one, and each direction, fixes two of the three rotations at most.
    if max(points - 1, 0) + directions >= 2:
        return ""
    return (
        f"Too few matches carry weight: {points} point{'s' * (points != 1)} and {directions} "
        f"direction{'s' * (directions != 1)}; at least three points, two points and a direction across, or one point "
        "and two directions are needed; for a rotation alone, two directions"
    )


def _too_light(matches: Matches) -> str:
    ones = [None if w is None else (w > 0.0).astype(np.float64) for w in _weights(matches)]
    alike = sums_of(replace(matches, point_weights=ones[0], direction_weights=ones[1]))
    H = np.zeros((3, 3))
    for cross, source, target in (
        (alike.point_cross, alike.spread_source, alike.spread_target),
        (alike.direction_cross, alike.length_source, alike.length_target),
    ):
        size = math.sqrt(source) * math.sqrt(target)
        H += cross / size if size > 0.0 else 0.0
    s1, s2, s3 = _singular_values(H)
    if not s2 + s3 > CANCELLED_RATIO * s1:
        return ""
    beta, alpha = (None if w is None else w[w > 0.0] for w in _weights(matches))
    ranges = [
        f"{name} {w.min():.3g} to {w.max():.3g}"
        for name, w in (("point_weights", beta), ("direction_weights", alpha))
        if w is not None and len(w)
    ]
    return (
        "With equal weights the rotation would be determined: what fixes it carries too little weight beside the rest "
        f"({', '.join(ranges) or 'all weights 1'}, in squared lengths). Raise it, or lower the others"
    )


def _weights(matches: Matches) -> tuple[FloatArray | None, FloatArray | None]:
    return matches.point_weights, matches.direction_weights


def _singular_values(H: FloatArray) -> tuple[float, float, float]:
    """Singular values of H, the last negative where the determinant is."""
    s = np.linalg.svd(H, compute_uv=False)
    return float(s[0]), float(s[1]), float(s[2]) * (-1.0 if np.linalg.det(H / (s[0] or 1.0)) < 0.0 else 1.0)
