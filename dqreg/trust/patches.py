"""Patches of neighbouring points that lie off the target as a whole: what a wrong pose or another part leaves."""

from __future__ import annotations

import numpy as np

from dqreg.arrays import BoolArray, FloatArray

# Neighbouring points of a patch, and the widths that its median distance may be off: for 32 points of independent
# noise the median is good to a quarter of a width.
PATCH, OFF = 32, 2.0
# Widths within which a point counts as lying on a surface; real scans have longer tails than a Gaussian.
ON = 4.0
# A patch whose plane holds so many times as many points far from the target as near it belongs to something that the
# part stands on or leans against.
GOES_ON = 1.0


def patches_off(
    points: FloatArray, apart: FloatArray, aside: FloatArray, near: BoolArray, width: float
) -> tuple[int, float]:
    """Count the patches near the target, and the share of them that lies off it.

    A stray leaves the median of its patch alone; a face in the wrong place moves it. A table that touches the part does
    too: patches whose plane goes on far from the target are not looked at.
    """
    count = len(points) // PATCH
    if count == 0:
        return 0, 0.0
    whole = slice(count * PATCH)
    d, a, close = (x[whole].reshape(count, PATCH) for x in (apart, aside, near))
    off = (np.abs(np.median(a, axis=1)) > OFF * width) | (np.median(d, axis=1) > ON * width)
    looked_at = close.mean(axis=1) >= 0.5
    doubtful = np.flatnonzero(off & looked_at)
    if len(doubtful) and not near.all():
        patches = points[whole].reshape(count, PATCH, 3)[doubtful]
        looked_at[doubtful[_goes_on(patches, points[near], points[~near], width)]] = False
    total = int(np.count_nonzero(looked_at))
    return total, float(np.count_nonzero(off & looked_at)) / total if total else 0.0


def _goes_on(patches: FloatArray, near: FloatArray, far: FloatArray, width: float) -> BoolArray:
    """Which patches lie in a plane that holds more points far from the target than near it, (k,)."""
    # The median point and the flattest axis: some points of a patch may be of the part that stands on the table.
    middles = np.median(patches, axis=1)
    centred = patches - patches.mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.matmul(centred.transpose(0, 2, 1), centred))[1][:, :, 0]
    heights = np.einsum("ki,ki->k", normals, middles)
    on_far, on_near = (
        np.count_nonzero(np.abs(some @ normals.T - heights) <= ON * width, axis=0) for some in (far, near)
    )
    return np.asarray(on_far > GOES_ON * on_near)
