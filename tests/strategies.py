"""Hypothesis strategies of rigid motions; they draw the numbers themselves, so that a failure shrinks.

Every strategy mixes plain draws with the hard ones: no turn, turns of 1e-7 and less, half-turns and nearly so,
and translations a million times the part. Each strategy is made once: Hypothesis looks through a new one at its first
draw, which takes longer than to draw from it.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_AXES = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [-0.6, 0.8, 0.0]]
_ANGLES_RAD = [0.0, 1e-12, 1e-9, 1e-7, 1e-4, np.pi / 2, np.pi - 1e-4, np.pi - 1e-7, np.pi, np.pi + 1e-7, 2 * np.pi]
_LENGTHS = [0.0, 1e-6, 1.0, 1e3, 1e6]
_COINS, _SOME_AXES = st.booleans(), st.sampled_from(_AXES)


@cache
def floats(low: float, high: float) -> st.SearchStrategy[float]:
    """Draw finite numbers between two bounds, without subnormal ones."""
    return st.floats(low, high, allow_nan=False, allow_infinity=False, allow_subnormal=False)


@cache
@st.composite
def unit_vectors(draw: st.DrawFn) -> FloatArray:
    """Draw unit vectors (3,): along the axes, or anywhere."""
    if draw(_COINS):
        return np.array(draw(_SOME_AXES))
    z, azimuth_rad = draw(floats(-1.0, 1.0)), draw(floats(0.0, 6.3))
    ring = np.sqrt(1.0 - z * z)
    return np.array([ring * np.cos(azimuth_rad), ring * np.sin(azimuth_rad), z])


@cache
def angles() -> st.SearchStrategy[float]:
    """Draw angles in [0, 2 pi] radians: the hard ones, or any."""
    return st.one_of(st.sampled_from(_ANGLES_RAD), floats(0.0, 2 * np.pi))


@cache
@st.composite
def unit_quaternions(draw: st.DrawFn) -> FloatArray:
    """Draw unit quaternions (4,), scalar first, of either sign; half-turns have a scalar of exactly zero."""
    axis, angle_rad = draw(unit_vectors()), draw(angles())
    if angle_rad == np.pi:
        return np.array([0.0, *axis])
    return np.array([np.cos(angle_rad / 2), *(np.sin(angle_rad / 2) * axis)])


@cache
@st.composite
def rotations(draw: st.DrawFn) -> FloatArray:
    """Draw rotation matrices (3, 3), written out entry by entry from a unit quaternion."""
    w, x, y, z = draw(unit_quaternions())
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@cache
def _some_lengths() -> st.SearchStrategy[float]:
    return st.one_of(st.sampled_from(_LENGTHS), floats(0.0, 100.0))


@cache
@st.composite
def translations(draw: st.DrawFn) -> FloatArray:
    """Draw translations (3,), from none to a million units."""
    length = draw(_some_lengths())
    return length * draw(unit_vectors())


@cache
@st.composite
def poses(draw: st.DrawFn) -> FloatArray:
    """Draw rigid poses (4, 4)."""
    T = np.eye(4)
    T[:3, :3] = draw(rotations())
    T[:3, 3] = draw(translations())
    return T


@cache
def _rows(min_size: int, max_size: int) -> st.SearchStrategy[list[tuple[float, float, float]]]:
    return st.lists(st.tuples(*[floats(-1e3, 1e3)] * 3), min_size=min_size, max_size=max_size)


@cache
@st.composite
def points(draw: st.DrawFn, min_size: int = 0, max_size: int = 20) -> FloatArray:
    """Draw point sets (n, 3) within a box of 2,000 units about the origin."""
    rows = draw(_rows(min_size, max_size))
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


@cache
def _norms() -> st.SearchStrategy[float]:
    return st.one_of(st.just(1.0), floats(1e-3, 1e3))


@cache
@st.composite
def quaternions(draw: st.DrawFn) -> FloatArray:
    """Draw quaternions (4,) of any norm from 1e-3 to 1e3, scalar first."""
    return draw(unit_quaternions()) * draw(_norms())
