"""The worst places of a scan: patches that deviate, not lone strays."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg.arrays import FloatArray, IntArray

# Points that must deviate at least that much at a place, so that strays make none ...
FEWEST = 5
# ... and at least this share of the points of its cell.
SHARE = 0.05
# Below that many points a touch probe measured, and every point is meant.
PROBED = 200
# A place holds the points that deviate at least that share of its own deviation.
SAME = 0.5


@dataclasses.dataclass(frozen=True)
class Place:
    """A patch that deviates.

    Attributes
    ----------
    value : float
        Deviation of the patch: the fifth largest there, or the value that a twentieth of the points of its cell
        reach, whichever is smaller in size; signed, target units.
    position : ndarray, (3,)
        The scan point that has this deviation, in the caller's target frame.
    points : int
        Points around it that deviate at least half as much to the same side.
    row : int
        Row of that point in the scan.
    """

    value: float
    position: FloatArray
    points: int
    row: int


def worst_places(feet: FloatArray, values: FloatArray, count: int, apart: float) -> list[Place]:
    """Largest deviations, at places that are apart.

    The target is cut into cells as wide as places are apart, one for either sign. A cell counts with the deviation that
    at least 5 of its points, and a twentieth of them, reach: four strays in a cell change nothing, and neither do
    strays all over the scan while they are fewer than that. Of two places nearer than ``apart`` the worse stays. Clouds
    of fewer than 200 points are probed by hand, and each of their points counts.
    """
    if not len(values) or count < 1:
        return []
    rows = _cell_rows(feet, values, apart)
    places: list[Place] = []
    for row in rows[np.argsort(-np.abs(values[rows]), kind="stable")]:
        if len(places) == count or values[row] == 0.0:
            break
        if all(math.dist(feet[row], place.position) >= apart for place in places):
            places.append(_place(feet, values, int(row), apart))
    return places


def _cell_rows(feet: FloatArray, values: FloatArray, apart: float) -> IntArray:
    """One row for each cell and sign: the point whose deviation the cell counts with."""
    fewest = FEWEST if len(values) >= PROBED else 1
    cells = np.floor((feet - feet.min(axis=0)) / apart).astype(np.int64)
    wide = cells.max(axis=0) + 1
    key = 2 * ((cells[:, 0] * wide[1] + cells[:, 1]) * wide[2] + cells[:, 2]) + (values > 0.0)
    order = np.lexsort((-np.abs(values), key))
    key = key[order]
    first = np.flatnonzero(np.concatenate([[True], key[1:] != key[:-1]]))
    sizes = np.diff(np.append(first, len(key)))
    # Points of the whole cell, whatever their sign.
    _, cell = np.unique(key[first] // 2, return_inverse=True)
    whole = np.bincount(cell, weights=sizes)[cell]
    rank = np.maximum(np.ceil(SHARE * whole).astype(np.int64) if fewest > 1 else 1, fewest)
    enough = sizes >= rank
    rows: IntArray = order[(first + rank - 1)[enough]]
    return rows


def _place(feet: FloatArray, values: FloatArray, row: int, apart: float) -> Place:
    value = float(values[row])
    alike = np.flatnonzero(values * math.copysign(1.0, value) >= SAME * abs(value))
    near = np.linalg.norm(feet[alike] - feet[row], axis=1) <= apart
    return Place(value, feet[row], int(np.count_nonzero(near)), row)
