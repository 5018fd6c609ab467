"""Normals of a scan against those of its own neighbourhoods moved onto the target.

A neighbourhood that spans an edge, that lies on few rings of a LiDAR or that is noisy has another normal than the face
its point is closest to, at the right pose too. The closest points of its members show what it would be on the target:
at a right pose they lie in the same plane, where faces cross they do not.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import NEIGHBOURS, fit_planes_among, sample_rows

# Neighbourhoods that are looked at; those flatter than this, in their extent, have a normal worth comparing.
LOOKED_AT, SMOOTH = 1_500, 0.4
# Normals farther apart than this are of different faces.
APART_COS = np.cos(np.deg2rad(35.0))
# Thickness of a scan in its length: what is thinner may be a single profile, whose neighbourhoods turn freely about it.
FLAT = 0.02


def share_apart(points: FloatArray, feet: FloatArray, normals: FloatArray, on: BoolArray) -> float:
    """Share of the neighbourhoods on the target whose normal is neither that of the target nor that of their feet.

    NaN where too few are there, or where they are of a single profile, which has no normals.

    Shapes: points, feet (their closest points), normals (the target's there) (n, 3), on (n,).
    """
    rows = np.flatnonzero(on)
    if len(rows) <= NEIGHBOURS or is_flat(points[rows]):
        return np.nan
    rows = rows[sample_rows(len(rows), LOOKED_AT)]
    indices, _ = NeighbourTree(points).nearest(points[rows], NEIGHBOURS)
    own, there = fit_planes_among(points, indices), fit_planes_among(feet, indices)
    with np.errstate(divide="ignore", invalid="ignore"):
        flat = np.nan_to_num(own.residuals / np.sqrt(own.lever), nan=np.inf) < SMOOTH
    flat &= normals[rows].any(axis=1)
    if not flat.any():
        return np.nan
    scan = np.nan_to_num(own.normals[flat])
    others = normals[rows][flat], np.nan_to_num(there.normals[flat])
    apart = [np.abs(np.einsum("ij,ij->i", scan, other)) < APART_COS for other in others]
    return float(np.mean(apart[0] & apart[1]))


def is_flat(points: FloatArray) -> bool:
    """Whether points, (n, 3), lie in one plane: a single profile, or one face, is a weak witness of a pose."""
    values = np.linalg.eigvalsh(np.cov(points.T))
    return bool(values[0] < FLAT**2 * values[2])
