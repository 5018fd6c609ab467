"""Matched points and directions with their weights: what every solver takes, checked at the door."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dqreg._arrays import FloatArray, as_vectors, as_weights, require_finite, require_workable
from dqreg.errors import InputError


@dataclass(frozen=True, slots=True, eq=False)
class Matches:
    """Row i of the source belongs to row i of the target; the two numbers of rows, n and m, may differ.

    Attributes
    ----------
    points_source, points_target : ndarray, (n, 3)
        Matched points, p and q.
    directions_source, directions_target : ndarray, (m, 3)
        Matched directions, called m and n in the formulas; no rows where none were given.
    point_weights : ndarray, (n,), or None
        beta, one a point; None where all are 1. Zero rejects a match.
    direction_weights : ndarray, (m,), or None
        alpha, one a direction; None where all are 1. Zero rejects a match.
    """

    points_source: FloatArray
    points_target: FloatArray
    directions_source: FloatArray
    directions_target: FloatArray
    point_weights: FloatArray | None = None
    direction_weights: FloatArray | None = None


def read_matches(
    points_source: ArrayLike,
    points_target: ArrayLike,
    directions_source: ArrayLike | None = None,
    directions_target: ArrayLike | None = None,
    point_weights: ArrayLike | None = None,
    direction_weights: ArrayLike | None = None,
) -> Matches:
    """Check shapes, counts and weights; the values of points and directions are left to `refuse_bad_values`.

    Parameters
    ----------
    points_source, points_target : array_like, (n, 3)
        Matched points.
    directions_source, directions_target : array_like, (m, 3), optional
        Matched directions; both or none.
    point_weights : array_like, (n,) or float, optional
        beta; 1 where not given.
    direction_weights : array_like, (m,) or float, optional
        alpha; 1 where not given.

    Returns
    -------
    Matches
        Float64 arrays; the caller's own where they already are.

    Raises
    ------
    InputError
        If a shape or a count is wrong, a weight is negative or not finite, or there are no matches at all.

    Examples
    --------
    >>> read_matches([[0, 0, 0]], [[1, 2, 3]]).directions_source.shape
    (0, 3)
    """
    points = _read_pair(points_source, points_target, "points")
    if (directions_source is None) != (directions_target is None):
        missing = "directions_source" if directions_source is None else "directions_target"
        raise InputError(f"{missing} is missing; give the directions of both sides or of neither")
    if directions_source is None or directions_target is None:
        if direction_weights is not None:
            raise InputError("direction_weights was given without directions; give the directions or leave it out")
        directions = (np.zeros((0, 3)), np.zeros((0, 3)))
    else:
        directions = _read_pair(directions_source, directions_target, "directions")
    if not len(points[0]) and not len(directions[0]):
        raise InputError("points_source has no rows; at least one matched point is needed")
    beta = None if point_weights is None else as_weights(point_weights, "point_weights", len(points[0]))
    alpha = (
        None if direction_weights is None else as_weights(direction_weights, "direction_weights", len(directions[0]))
    )
    return Matches(*points, *directions, beta, alpha)


def refuse_bad_values(matches: Matches) -> None:
    """Raise if a point or direction is not finite, or a direction has no length."""
    for name in ("points_source", "points_target", "directions_source", "directions_target"):
        array = getattr(matches, name)
        require_finite(array, name)
        if name.startswith("points") and len(array):
            require_workable(array, name)
        if name.startswith("directions"):
            refuse_zero_directions(array, name, matches.direction_weights)


def refuse_zero_directions(directions: FloatArray, name: str, weights: FloatArray | None = None) -> None:
    """Raise if a row that carries weight holds three zeros, which points nowhere.

    Shapes: weights (m,).
    """
    empty = ~directions.any(axis=1)
    zero = np.flatnonzero(empty if weights is None else empty & (weights > 0.0))
    if zero.size:
        raise InputError(
            f"{name} holds {zero.size} directions of length zero, the first in row {zero[0]}; "
            "leave them out or give them weight 0"
        )


def _read_pair(source: ArrayLike, target: ArrayLike, kind: str) -> tuple[FloatArray, FloatArray]:
    pair = (
        as_vectors(source, f"{kind}_source", finite=False),
        as_vectors(target, f"{kind}_target", finite=False),
    )
    if len(pair[0]) != len(pair[1]):
        raise InputError(
            f"{kind}_source has {len(pair[0])} rows and {kind}_target {len(pair[1])}; "
            "row i of one must match row i of the other"
        )
    return pair
