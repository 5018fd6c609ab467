"""Where the beams of a LiDAR begin, as its points tell: those of one ring scatter along their beams."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.geometry.boundary import runs_of
from dqreg.geometry.vector_rows import row_dots

# Points that lie next to another on its ring; neighbourhoods of these that tell.
RING_NEIGHBOURS, FEWEST_TOLD = 5, 100
# Sine of the angle between a plane and the beams that it is taken to be of. No face is seen from within its plane:
# two rings that meet one are 1.3 degrees apart, and its slant against the upper one is added to that.
BEAM_SINE = 0.02
# Share of the neighbourhoods that lie in planes of beams. Of simulated sweeps of 8 to 64 rings and rasters, with noise
# of 5 to 50 mm, 0.55 and more did; of roses, which have no rings, 0.27 at most.
BEAM_SHARE = 0.5
# Places that are tried, each where three planes meet, and the volume that their normals span at least.
TRIED_PLACES, LEAST_VOLUME = 32, 1e-6
# Sine that counts for all larger ones.
FAR_SINE = 0.1
# Noise of cells is this share of their edge at least where there is noise: ground is no plane.
LEAST_FLATNESS = 0.01
# Share of the sure planes that lie along beams at most: 0.02 of simulated sweeps, and 0.16 and more of exact ones, of
# which faces met in one place.
ALONG_SHARE = 0.05
# Steps from the best; below this sine a plane counts as any other does.
STEP_COUNT, LEAST_SINE = 10, 1e-3


@dataclasses.dataclass(frozen=True)
class Beams:
    """What the points next to each other on rings tell of the sensor."""

    origin: FloatArray | None = None  # (3,): The place through which most planes of these pass, where there is one
    noise: float = math.inf  # Median of how far they are off their lines, as a standard deviation

    def noise_of_cells(self, usual: float, edge: float) -> float:
        """What the means of cells of an edge leave of a plane through one face, where this is usual of all planes.

        Where most of these are across two faces the usual is ten times the noise.
        """
        return min(usual, max(self.noise, 0.0 if self.origin is None else LEAST_FLATNESS * edge))

    def along(self, points: FloatArray, normals: FloatArray, sure: BoolArray) -> BoolArray:
        """Which planes at points, (n, 3), are of beams, given their normals, (n, 3), and which are surely of faces.

        No sensor sees many faces from within their planes: where these meet in a place there is none.
        """
        if self.origin is None:
            return np.zeros(len(points), dtype=bool)
        found = along_beams(points, normals, self.origin)
        return found & (np.count_nonzero(found & sure) <= ALONG_SHARE * np.count_nonzero(sure))


def beams_of(points: FloatArray, order: IntArray) -> Beams:
    """Where beams begin, and the noise of points, (n, 3), with an order of space, (n,).

    Noise lies along the beams: of points on a line it makes a plane, in which the beams lie. Of the places where three
    planes meet, that with the least sum of the sines between planes and the lines to it is taken to the least by least
    squares with weights of one over each (Weiszfeld 1937), without those that are far off.
    """
    lined, axes, sums, places = runs_of(points, order, RING_NEIGHBOURS)
    told = lined & np.isfinite(axes[:, 0, 0])
    places, normals = places[told], axes[told, 0]
    if len(places) < FEWEST_TOLD:
        return Beams()
    noise = math.sqrt(float(np.median(sums[told, 1])) / (RING_NEIGHBOURS - 2))
    origin = _first_origin(places, normals)
    if origin is None:
        return Beams(noise=noise)
    for _ in range(STEP_COUNT):
        ranges = np.maximum(np.linalg.norm(places - origin, axis=1), np.finfo(float).tiny)
        sines = _sines(places, normals, origin)
        weights = (sines < FAR_SINE) / (ranges**2 * np.maximum(sines, LEAST_SINE))
        form = (normals * weights[:, None]).T @ normals
        if not np.linalg.cond(form) < 1.0 / LEAST_SINE**2:
            return Beams(noise=noise)
        origin = origin + np.linalg.solve(form, normals.T @ (weights * row_dots(places - origin, normals)))
    return Beams(origin if np.mean(along_beams(places, normals, origin)) > BEAM_SHARE else None, noise)


def _first_origin(places: FloatArray, normals: FloatArray) -> FloatArray | None:
    """The best of the places where three planes meet, (3,), by sums of sines that count up to a limit."""
    third = len(places) // 3
    rows = third * np.arange(3) + (third * np.arange(TRIED_PLACES) // TRIED_PLACES)[:, None]
    rows = rows[np.abs(np.linalg.det(normals[rows])) > LEAST_VOLUME]
    middle = np.median(places, axis=0)
    heights = np.einsum("ijk,ijk->ij", places[rows] - middle, normals[rows])
    met = middle + np.linalg.solve(normals[rows], heights[:, :, None])[:, :, 0]
    costs = [float(np.minimum(_sines(places, normals, place), FAR_SINE).sum()) for place in met]
    return np.asarray(met[int(np.argmin(costs))]) if costs else None


def along_beams(points: FloatArray, normals: FloatArray, origin: FloatArray) -> BoolArray:
    """Which planes at points, (n, 3), are of beams from a place, given their normals, (n, 3)."""
    return _sines(points, normals, origin) < BEAM_SINE


def _sines(points: FloatArray, normals: FloatArray, origin: FloatArray) -> FloatArray:
    arms = points - origin
    ranges = np.maximum(np.linalg.norm(arms, axis=1), np.finfo(float).tiny)
    return np.asarray(np.abs(row_dots(arms, normals)) / ranges)
