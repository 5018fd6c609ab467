"""Normals and noise of a scan, from its neighbourhoods and what they would be on the target.

A neighbourhood that spans an edge, that lies on few rings of a LiDAR or that is noisy has another normal than the face
its point is closest to, at the right pose too. The closest points of its members, the feet, show what it would be on
the target: at a right pose they lie in the same plane, where faces cross they do not. Where the feet lie on a line, the
neighbourhood is of a single profile: its plane is that of the laser, and says nothing of a face or of the noise.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.morton import morton_order
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NEIGHBOURS, PlaneFits, fit_planes_among, sample_rows

# Neighbourhoods that are looked at; those flatter than this, in their extent, have a normal worth comparing.
LOOKED_AT, SMOOTH = 1_500, 0.4
# Normals farther apart than this are of different faces; one that noise alone tilts by this much over the spread of its
# feet is no witness.
APART_COS, TILT_RAD = np.cos(np.deg2rad(35.0)), np.deg2rad(10.0)
# Neighbours that are of several profiles: what they leave of their planes is an upper estimate of the noise.
MANY = 3 * NEIGHBOURS
# Fewer of a single profile are those at rims.
PROFILES = 0.1
# Thickness of a scan in its length: what is thinner may be a single profile, whose neighbourhoods turn freely about it.
FLAT = 0.02
# Neighbourhoods without which no noise is estimated; and its quantile: in others there is an edge.
FEWEST, QUIET = 50, 0.3

# Of two scans at one pose: points that are asked about and neighbours of a plane; neighbourhoods are flat that leave so
# many times the noise of their planes, and are of one face where the normals agree.
ASKED, OF_A_PLANE, FLAT_BY, SAME_COS = 2_000, 8, 3.0, np.cos(np.deg2rad(10.0))
# Planes of the two lie apart by more than so many times the noise; neighbourhoods without which nothing is said.
APART, FEWEST_FLAT = 5.0, 100
# Means of neighbours in the two are at one place where they are less than this share of their extent beside each other.
BESIDE = 0.7


@dataclasses.dataclass(frozen=True)
class Neighbourhoods:
    """What the neighbourhoods on the target say; NaN where too few are there, or where they are of a single profile."""

    apart: float = np.nan  # Share of those whose normal is neither that of the target nor that of their feet
    noise: float = np.nan  # Distance of their points from their own plane, root mean square, where their feet are flat

    @staticmethod
    def of(points: FloatArray, feet: FloatArray, normals: FloatArray, on: BoolArray, width: float) -> Neighbourhoods:
        """Those of points on a target that they are from by so many lengths, one sigma.

        Shapes: points, feet (their closest points), normals (the target's there) (n, 3), on (n,).
        """
        rows = np.flatnonzero(on)
        if len(rows) <= NEIGHBOURS or is_flat(points[rows]):
            return Neighbourhoods()
        rows = rows[sample_rows(len(rows), LOOKED_AT)]
        tree = NeighbourTree(points)
        indices, _ = tree.nearest(points[rows], NEIGHBOURS)
        own, there = fit_planes_among(points, indices), fit_planes_among(feet, indices)
        with np.errstate(divide="ignore", invalid="ignore"):
            smooth = np.nan_to_num(own.residuals / np.sqrt(own.lever), nan=np.inf) < SMOOTH
        wide = fit_planes_among(points, tree.nearest(points[rows], min(MANY, len(points)))[0])
        noise = min(width, float(np.quantile(wide.residuals[np.isfinite(wide.residuals)], QUIET)))
        spans = noise / np.sqrt(NEIGHBOURS * np.maximum(there.lever, np.finfo(float).tiny)) < TILT_RAD
        spans |= np.mean(spans) >= 1.0 - PROFILES
        quiet = spans & (there.residuals <= width)
        noise = float(np.quantile(own.residuals[quiet], QUIET)) if np.count_nonzero(quiet) >= FEWEST else np.nan
        counted = smooth & spans & normals[rows].any(axis=1)
        if not counted.any():
            return Neighbourhoods(noise=noise)
        scan = np.nan_to_num(own.normals[counted])
        others = normals[rows][counted], np.nan_to_num(there.normals[counted])
        apart = [np.abs(np.einsum("ij,ij->i", scan, other)) < APART_COS for other in others]
        return Neighbourhoods(float(np.mean(apart[0] & apart[1])), noise)


def is_flat(points: FloatArray) -> bool:
    """Whether points, (n, 3), lie in one plane: a single profile, or one face, is a weak witness of a pose."""
    values = np.linalg.eigvalsh(np.cov(points.T))
    return bool(values[0] < FLAT**2 * values[2])


def faces_apart(
    placed: FloatArray, fixed: FloatArray, places: FloatArray, noise: float, covariance: FloatArray
) -> float:
    """Share of the flat neighbourhoods of two scans, at places where they overlap, that lie apart; NaN for few of them.

    Between clouds the distances of points are those between neighbours, not the noise: a front that is laid on a back,
    or on the next step, is as near. Means of neighbours in their common plane tell, where they are farther apart than
    noise and the pose's covariance about the origin (a free motion, NaN, slides along faces) leave them.

    Shapes: placed (n, 3), fixed (m, 3), places (k, 3), covariance (6, 6).
    """
    places = places[sample_rows(len(places), ASKED)]
    if min(len(placed), len(fixed)) < OF_A_PLANE or len(places) < FEWEST_FLAT or not noise > 0.0:
        return np.nan
    (own, here), (other, there) = (_planes(points, places) for points in (placed, fixed))
    flat = np.fmax(own.residuals, other.residuals) <= FLAT_BY * noise
    normals = np.nan_to_num(other.normals)
    flat &= np.abs(np.einsum("ij,ij->i", np.nan_to_num(own.normals), normals)) > SAME_COS
    apart = np.einsum("ij,ij->i", here - there, normals)
    # At the border of the overlap neighbours are beside the place, of another face perhaps.
    aside = np.linalg.norm(here - there - apart[:, None] * normals, axis=1)
    flat &= aside < BESIDE * np.sqrt(np.fmax(own.lever, other.lever))
    if np.count_nonzero(flat) < FEWEST_FLAT:
        return np.nan
    # Grazing views are noisier than the quietest places, which name the noise.
    local = np.maximum(noise, np.hypot(own.residuals, other.residuals)[flat] / np.sqrt(2.0))
    arms = np.hstack([np.cross(there[flat], normals[flat]), normals[flat]])
    local = np.hypot(local, np.linalg.norm(arms @ _root(covariance), axis=1))
    return float(np.mean(np.abs(apart[flat]) > APART * local))


def _root(covariance: FloatArray) -> FloatArray:
    """A matrix whose square is a covariance, (6, 6); what is NaN counts as zero."""
    values, vectors = np.linalg.eigh(np.nan_to_num(covariance, nan=0.0))
    root: FloatArray = vectors * np.sqrt(np.maximum(values, 0.0))
    return root


def _planes(points: FloatArray, places: FloatArray) -> tuple[PlaneFits, FloatArray]:
    points = points[morton_order(points)]
    indices = NeighbourTree(points, in_order=True).nearest(places, OF_A_PLANE)[0]
    return fit_planes_among(points, indices), points[indices].mean(axis=1)
