"""The fit against chance: how far below the distances at random poses those at the pose are."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, bounds
from dqreg.geometry import CloudSurface, Surface
from dqreg.geometry.normals import sample_rows

# Points asked about, at so many random poses.
ASKED_POINTS, RANDOM_POSES = 400, 24
# Quantile of those poses that the fit is compared with: an optimised pose of noise is somewhat better than the usual
# random one.
POSE_QUANTILE = 0.1
# Random poses: rotated by this much at least, and shifted by up to this share of the extent of the points.
MIN_ROTATION_RAD, MAX_SHIFT_EXTENTS = np.deg2rad(30.0), 0.15
# Residuals below this share of the extent of the points are never reached by chance.
CERTAIN_RESIDUAL_EXTENTS = 0.004
# Points within one cell of this share of their extent lie at one place; of so many points the places are counted.
PLACE_CELL_EXTENTS, COUNTED_POINTS = 0.01, 400


def places_of(points: FloatArray) -> int:
    """At how many distinct places points (n, 3) lie, of some of them: a place measured a hundred times fits once."""
    if not len(points):
        return 0
    some = points[sample_rows(len(points), COUNTED_POINTS)]
    low, high = bounds(some)
    cells = np.floor((some - low) / max(PLACE_CELL_EXTENTS * float(np.linalg.norm(high - low)), np.finfo(float).tiny))
    numbers = np.sort(cells @ (1.0, 2.0 / PLACE_CELL_EXTENTS, (2.0 / PLACE_CELL_EXTENTS) ** 2))
    return 1 + int(np.count_nonzero(numbers[1:] != numbers[:-1]))


def random_ratio(placed: FloatArray, inlying: float, rms: float, surface: Surface) -> float:
    """The rms distance of the inliers over that of as many points at random poses near by; 0 where far below chance.

    Shapes: placed (n, 3), the scan at the pose. About 1 is what noise reaches.
    """
    # Some of the points reach no farther than all, and mostly far enough to tell.
    some = placed[sample_rows(len(placed), COUNTED_POINTS)]
    extent = 0.0
    for each in (some, placed):
        extent = float(np.linalg.norm(np.subtract(*bounds(each)))) if len(each) else 0.0
        if not rms > CERTAIN_RESIDUAL_EXTENTS * extent:
            return 0.0
    from scipy.spatial.transform import Rotation

    points = placed[np.linspace(0, len(placed) - 1, min(ASKED_POINTS, len(placed))).round().astype(np.int64)]
    middle, count = points.mean(axis=0), max(round(inlying * len(points)), 1)
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(RANDOM_POSES, 3))
    angles = rng.uniform(MIN_ROTATION_RAD, np.pi, (RANDOM_POSES, 1))
    rotations = Rotation.from_rotvec(angles * axes / np.linalg.norm(axes, axis=1, keepdims=True)).as_matrix()
    shifts = rng.uniform(-MAX_SHIFT_EXTENTS, MAX_SHIFT_EXTENTS, (RANDOM_POSES, 3)) * extent
    moved = (points - middle) @ rotations.transpose(0, 2, 1) + (middle + shifts)[:, None, :]
    queries = moved.reshape(-1, 3)
    apart = surface._distances(queries) if isinstance(surface, CloudSurface) else surface.closest(queries).distances
    squares = apart.reshape(RANDOM_POSES, -1) ** 2
    trimmed = np.partition(squares, count - 1, axis=1)[:, :count].mean(axis=1)
    return float(rms / max(np.sqrt(np.quantile(trimmed, POSE_QUANTILE)), np.finfo(float).tiny))
