"""Weights of correspondences between two clouds, lowered once more: by heights, by distances and by noise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, quantile
from dqreg._records import made_once
from dqreg.geometry.cells import CellSurface
from dqreg.geometry.scan import Scan
from dqreg.icp.correspondences import Correspondences
from dqreg.icp.weighing import NOTHING
from dqreg.solvers.robust import GAUSSIAN_MEDIAN

if TYPE_CHECKING:
    from dqreg.kernels.steps.plane_pass import Lowering

# Heights, in their usual size, at which a correspondence between cells counts half, and on the last level distances, in
# their median. Of 60 simulated streets under a LiDAR the errors fell to a half, the worst to a fifth; measured pairs
# lost up to a twentieth. At 6 and 1, and at 20 and 2, the streets lost less or these gained.
HALF_WEIGHT_HEIGHTS, HALF_WEIGHT_DISTANCES = 12.0, 1.5
# Heights are no less than this share of the edge of a cell: nothing is so flat. Walls without noise left a waved ground
# no weight, and streets came 2 mm off that came within 0.2 mm under noise of 5 mm.
LEAST_FLATNESS = 1e-3
# Variance of both normals, rad^2, at which a correspondence counts half; more where all but this share of them has
# more. Where the noise of a depth camera, which grows with the square of the distance, is beyond the spacing of its
# points, any of them is near any other: they hold the pose where it is. Of simulated tables before a far wall errors
# fell to a quarter and, with half as much noise again, to an eighth, their squares from 3 and 10 of the covariance to
# 0.3.
HALF_WEIGHT_VARIANCE, SURE_SHARE = 0.05, 0.1
# Asked where the squares of the spacings of a scan, by its neighbourhoods, spread so wide from its first to its last
# tenth: depth cameras came to 5 and more, scans of parts to 3.4 at most. There edges and small details are no planes
# either, and hold what the faces do not.
MIN_SPREAD_RATIO = 5.0
# Of planes that are not known to be flat far around.
NONE_FLAT = np.zeros(0, dtype=bool)


def lowering_of(pairs: Correspondences, *, is_last: bool) -> Lowering:
    """How weights are lowered; on the last level by more than heights.

    By heights: cells are as far apart as they are wide, which is all that the kernel of their distances knows. Beside a
    kerb, on which they stand askew, they are off by a fraction of that, and by many times what others are. Cauchy's
    weight.

    By distances: a surface bends away from its plane by the square of the way along it, so that the variance of the
    height grows with its fourth power. Where the rings of a LiDAR are metres apart on the ground, cells have their
    partners at the next ring: few as they are, their long levers would decide on roll and pitch. A plane that was found
    flat far around does not bend, and leans by the error of its normal: the variance grows with the square, and what it
    holds alone it does.

    By noise: next to none where neighbourhoods are noise, and no planes. Cells are rid of theirs.
    """
    from dqreg.kernels.steps.plane_pass import Lowering

    if isinstance(pairs.surface, CellSurface):
        # Noise that both clouds were rid of is no reason to believe less in faces that are not in place yet.
        rid_of, edge = math.sqrt(2.0) * pairs.surface.smoothed_by, pairs.surface.cells.size
        smoothed = math.hypot(rid_of, LEAST_FLATNESS * edge)
        distances = HALF_WEIGHT_DISTANCES if is_last else 0.0
        return Lowering(HALF_WEIGHT_HEIGHTS * GAUSSIAN_MEDIAN, smoothed, distances, 0.0, 0.0)
    is_noisy = is_last and pairs.closest.variances is not None and lever_spread(pairs.scan) >= MIN_SPREAD_RATIO
    return Lowering(0.0, 0.0, 0.0, HALF_WEIGHT_VARIANCE if is_noisy else 0.0, SURE_SHARE)


def lever_spread(scan: Scan) -> float:
    """How far the levers of a scan spread, from their first to their last tenth: a ratio; NaN where there are none."""

    def spread() -> float:
        known = scan.levers[scan.levers > 0.0]
        return quantile(known, 0.9) / quantile(known, 0.1)

    # Asked at each step of a loop.
    return made_once(scan, "_lever_spread", spread)


def flat_planes(pairs: Correspondences) -> BoolArray:
    """Which of the target's planes were found flat far around, (n,); (0,) where none was looked for."""
    surface = pairs.surface
    if not isinstance(surface, CellSurface) or not surface.has_wide:
        return NONE_FLAT
    flat: BoolArray = np.take(surface.wide, pairs.closest.elements)
    return flat


def lowered_weights(pairs: Correspondences, weights: FloatArray, *, is_last: bool) -> FloatArray:
    """Weights between two clouds, (n,), lowered: see `lowering_of`."""
    from dqreg.kernels.steps.plane_pass import lower_weights
    from dqreg.kernels.threads import as_plain

    lowering, found = lowering_of(pairs, is_last=is_last), pairs.closest
    if not any(lowering[:-1]):
        return weights
    variances = NOTHING if found.variances is None else found.variances
    moved, points, normals, distances = map(as_plain, (pairs.moved, found.points, found.normals, found.distances))
    of_planes = flat_planes(pairs), as_plain(variances), as_plain(pairs.scan._variances)
    lowered = np.array(weights)
    lower_weights(moved, points, normals, distances, *of_planes, lowering, lowered)
    return lowered
