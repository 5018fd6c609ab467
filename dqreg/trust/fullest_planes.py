"""The planes that hold most of the places which two clouds have in common."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, IntArray, product
from dqreg.geometry.normals import sample_rows
from dqreg.trust.face_rims import Plane
from dqreg.trust.overlap import Overlap

# Planes of a corner, which fix a pose and leave nothing to check it by; most planes that are found, of which a corner
# may have some more by chance or beside a face's edges; the share of the common places that they hold, and the share
# below which a plane is none; places that are tried as one of it.
CORNER, PLANES, ALL, LEAST_SHARE, TRIED = 3, 6, 0.95, 0.02, 30
# A plane: normals within this angle, and distances within this share of the size, or so many times the noise.
SAME_COS, WITHIN, NOISY = np.cos(np.deg2rad(8.0)), 5e-3, 3.0
# Places look the same way within this angle.
ALIKE_COS = np.cos(np.deg2rad(30.0))


def fullest_planes(overlap: Overlap, within: float) -> tuple[tuple[Plane, ...], tuple[float, ...]]:
    """Planes that hold the common places, the fullest first, and the share that each of them holds."""
    left = np.ones(len(overlap.points), dtype=bool)
    planes: list[Plane] = []
    shares: list[float] = []
    for k in range(PLANES):
        rows = np.flatnonzero(left)
        if len(rows) < LEAST_SHARE * len(left) or (k >= CORNER and sum(shares) >= ALL):
            break
        held = _fullest(overlap, rows[sample_rows(len(rows), TRIED)], left, within)
        points = overlap.points[held]
        middle = points.mean(axis=0)
        planes.append(Plane(middle, np.linalg.eigh((points - middle).T @ (points - middle))[1][:, 0]))
        shares.append(float(np.mean(held)))
        left &= ~held
    return tuple(planes), tuple(shares)


def shares_alike(overlap: Overlap, planes: tuple[Plane, ...], shares: tuple[float, ...]) -> tuple[float, ...]:
    """Share of the places that look the same way as each of the planes, held by it and those parallel to it."""
    normals = np.array([plane.normal for plane in planes])
    looking = np.mean(np.abs(product(normals, overlap.normals.T)) > ALIKE_COS, axis=1)
    held = (np.abs(normals @ normals.T) > SAME_COS) @ np.array(shares)
    return tuple((held / np.maximum(looking, held)).tolist())


def _fullest(overlap: Overlap, tried: IntArray, left: BoolArray, within: float) -> BoolArray:
    """Which places, (n,), of those left lie in the plane of one of some, of that in which most do."""
    normals = overlap.normals[tried]
    offsets = np.einsum("ij,ij->i", overlap.points[tried], normals)[:, None]
    held = left & (np.abs(product(normals, overlap.points.T) - offsets) < within)
    held &= np.abs(product(normals, overlap.normals.T)) > SAME_COS
    fullest: BoolArray = held[np.count_nonzero(held, axis=1).argmax()]
    return fullest
