"""Where the beams of a LiDAR begin, as its points tell: those of one ring scatter along their beams."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.boundary import runs_of
from dqreg.geometry.vector_rows import row_dots

# Points that lie next to another on its ring; neighbourhoods of these that tell.
RING_NEIGHBOURS, FEWEST_TOLD = 5, 100
# Sine of the angle between a plane and the beams that it is taken to be of. No face is seen from within its plane:
# two rings that meet one are 1.3 degrees apart, and its slant against the upper one is added to that.
BEAM_SINE = 0.02
# Share of the neighbourhoods that lie in planes of beams. Of simulated sweeps of 16 to 64 rings with noise of 5 to 50
# mm 0.7 and more did; of exact ones, where planes are those of the faces, 0.3 at most.
BEAM_SHARE = 0.5
# Steps to the place; below this sine a plane counts as any other does.
STEP_COUNT, LEAST_SINE = 20, 1e-3


def origin_of_beams(points: FloatArray, order: IntArray) -> FloatArray | None:
    """The place through which most planes of neighbours along rings pass, (3,); None where there is none.

    Noise lies along the beams: of points on a line it makes a plane, in which the beams lie. The place has the least
    sum of the sines between planes and the lines to it, by least squares with weights of one over each (Weiszfeld
    1937). Shapes: points (n, 3), and an order of space, (n,).
    """
    lined, axes, _, places = runs_of(points, order, RING_NEIGHBOURS)
    told = lined & np.isfinite(axes[:, 0, 0])
    places, normals = places[told], axes[told, 0]
    if len(places) < FEWEST_TOLD:
        return None
    origin = np.median(places, axis=0)
    for _ in range(STEP_COUNT):
        ranges = np.maximum(np.linalg.norm(places - origin, axis=1), np.finfo(float).tiny)
        weights = 1.0 / (ranges**2 * np.maximum(_sines(places, normals, origin), LEAST_SINE))
        form = (normals * weights[:, None]).T @ normals
        if not np.linalg.cond(form) < 1.0 / LEAST_SINE**2:
            return None
        origin = origin + np.linalg.solve(form, normals.T @ (weights * row_dots(places - origin, normals)))
    return np.asarray(origin) if np.mean(along_beams(places, normals, origin)) > BEAM_SHARE else None


def along_beams(points: FloatArray, normals: FloatArray, origin: FloatArray) -> BoolArray:
    """Which planes at points, (n, 3), are of beams from a place, given their normals, (n, 3)."""
    return _sines(points, normals, origin) < BEAM_SINE


def _sines(points: FloatArray, normals: FloatArray, origin: FloatArray) -> FloatArray:
    arms = points - origin
    ranges = np.maximum(np.linalg.norm(arms, axis=1), np.finfo(float).tiny)
    return np.asarray(np.abs(row_dots(arms, normals)) / ranges)
