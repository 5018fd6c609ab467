"""Which patches deviate because the part is deformed there: the rest of their face is in its place.

A wrong pose displaces a face as a whole, or tilts it: a function that is linear on a plane and zero on most of it is
zero on all of it. Where most of a face is on the target and some of it is not, no motion explains that, but a bend, a
dent or a warp does.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg.trust.patch_tests import PATCH_POINTS

# Normals within this angle are of one face that looks one way, and so do its patches stand to each other: the sine.
SAME_WAY_COS = 0.95
SAME_WAY_SIN = float(np.sqrt(1.0 - SAME_WAY_COS**2))
# Patches beside each other that are asked whether they continue each other.
PATCHES_BESIDE = 8


def in_their_face(feet: FloatArray, normals: FloatArray, off: BoolArray, counted: BoolArray) -> BoolArray:
    """Which patches that are off lie on faces of which most is on the target, (k,).

    Shapes: feet (n, 3), the places of points on the target, normals (n, 3) there, so many after each other a patch, off
    and counted (k,).
    """
    feet, normals = (x[: PATCH_POINTS * len(off)].reshape(len(off), PATCH_POINTS, 3) for x in (feet, normals))
    asked = off & counted
    if not asked.any() or asked.sum() == counted.sum():
        return np.zeros(len(off), dtype=bool)
    rows = np.flatnonzero(counted)
    middles, ways = _faces(feet[rows], normals[rows])
    labels, alike = _continued(middles, ways), ways @ ways.T > SAME_WAY_COS
    peers = alike & (labels[:, None] == labels)
    is_off = off[rows]
    found = np.zeros(len(off), dtype=bool)
    found[rows] = is_off & (2 * np.count_nonzero(peers & is_off, axis=1) < np.count_nonzero(peers, axis=1))
    return found


def _faces(feet: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Middle and normal, (k, 3) each, of the face on which most of the points of each patch lie."""
    alike = np.matmul(normals, normals.transpose(0, 2, 1)) > SAME_WAY_COS
    own = alike[np.arange(len(feet)), np.count_nonzero(alike, axis=2).argmax(axis=1)].astype(float)
    middles, ways = (np.einsum("km,kmi->ki", own, x) for x in (feet, normals))
    lengths = np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), np.finfo(float).tiny)
    return middles / np.maximum(own.sum(axis=1, keepdims=True), 1.0), ways / lengths


def _continued(middles: FloatArray, ways: FloatArray) -> IntArray:
    """Numbers, (k,), that are the same for patches that lead to each other without an edge or a step."""
    from dqreg.kernels.clouds.components import components

    steps = middles[None] - middles[:, None]
    lengths = np.linalg.norm(steps, axis=2)
    beside = np.argsort(lengths, axis=1, kind="stable")[:, : PATCHES_BESIDE + 1]
    one, two = np.repeat(np.arange(len(middles)), beside.shape[1]), beside.ravel()
    along, reach = steps[one, two], SAME_WAY_SIN * lengths[one, two]
    level = np.maximum(*(np.abs(np.einsum("ij,ij->i", along, ways[ends])) for ends in (one, two))) <= reach
    linked = level & (np.einsum("ij,ij->i", ways[one], ways[two]) > SAME_WAY_COS)
    return np.asarray(components(len(middles), one[linked], two[linked]))
