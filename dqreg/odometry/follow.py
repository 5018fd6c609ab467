"""A frame followed onto the planes of the map: matches are searched rarely, and between two searches all is solved.

The next pose, and the kernel that its distances ask for, cost a tenth of the search for the matches. So each search is
followed by as many steps as its planes are good for.
"""

from __future__ import annotations

import dataclasses
import math
import time

import numpy as np

from dqreg._arrays import FloatArray, median
from dqreg.geometry import Scan
from dqreg.geometry.surface import Closest
from dqreg.icp import Alignment, InlierMixture
from dqreg.icp.correspondences import Correspondences, find_correspondences
from dqreg.icp.history import Iteration
from dqreg.icp.level import NEAR_ANGLE_RAD, PLACED, STEEPEST
from dqreg.icp.loop import FEWEST_PAIRS
from dqreg.odometry.kiss import rigid
from dqreg.odometry.map_surface import MapSurface
from dqreg.rigid import single_pose
from dqreg.solvers.status import Status

# A step that is so much shorter than the way since the search waits for the next search.
SHORT = 0.05
# A scale that falls by less in all steps of a search is settled.
SETTLED = 0.8


@dataclasses.dataclass(frozen=True)
class Following:
    """How far a frame is followed."""

    stage: str  # Shown with each search
    steps: int  # Steps on the planes of one search at most
    searches: int  # At most
    enough: float  # Root mean square motion of the points since the search that ends it, a length; 0: their noise does
    far: float = math.inf  # Distance at which a match counts half, over the median of all


def follow(
    scan: Scan,
    surface: MapSurface,
    T: FloatArray,
    mixture: InlierMixture,
    how: Following,
    *,
    floor: float,
    first: int = 1,
    before: Correspondences | None = None,
) -> Alignment:
    """The pose of a frame near a known one, (4, 4), with matches no farther off than the limit of the mixture."""
    from dqreg.kernels.plane_steps import FIGURES, step_on_planes
    from dqreg.kernels.threads import as_plain

    points, own = as_plain(scan.points), as_plain(scan._gating)
    lever = math.sqrt(float(np.einsum("ij,ij->", points, points)) / max(len(points), 1))
    history: list[Iteration] = []
    last = 0.0
    while True:
        began = time.perf_counter()
        pairs = before = find_correspondences(scan, surface, T, before)
        found = pairs.closest
        weights, figures, moved = np.zeros(len(points)), np.zeros(FIGURES), T.copy()
        enough = max(how.enough, PLACED * mixture.scale / math.sqrt(max(len(points), 1)))
        angle = min(max(math.pi * mixture.scale / mixture.limit, NEAR_ANGLE_RAD), 0.5 * math.pi)
        scales = mixture.scale, mixture.inlier_fraction, floor, STEEPEST
        limits = np.array([mixture.limit, math.cos(angle), *scales, lever, SHORT * enough, _far(found, how.far)])
        columns = points, own, found.points, found.normals, found.distances
        step_on_planes(*columns, limits, how.steps, moved, weights, figures)
        scale, fraction, energy, total, squares, used, _ = figures.tolist()
        if used < FEWEST_PAIRS:
            return Alignment(T, "no correspondences", tuple(history), pairs, weights, mixture=mixture)
        after = rigid(moved)
        motion = float(scan._spread.motion(T, after))
        record = Iteration(
            number=first + len(history),
            stage=how.stage,
            points=len(points),
            pairs=int(used),
            inlier_fraction=total / len(points),
            rms=math.sqrt(squares / total),
            kernel_scale=mixture.scale,
            energy=energy,
            turn_rad=single_pose.angle_between(T, after),
            motion=motion / surface.diagonal,
            seconds=time.perf_counter() - began,
            T_target_source=after,
        )
        history.append(record)
        settled = scale >= SETTLED * mixture.scale
        mixture, T = InlierMixture(scale, fraction, mixture.limit), after
        # Of two motions the next one can be told.
        to_come = motion * min(motion / last, 1.0) if last > 0.0 else motion
        status: Status | None = "converged" if to_come <= enough and settled else None
        last = motion
        if status is None and len(history) >= how.searches:
            status = "iteration limit"
        if status is not None:
            return Alignment(T, status, tuple(history), pairs, weights, mixture=mixture)


def _far(found: Closest, share: float) -> float:
    """The distance at which a match counts half: rings that are metres apart on the ground meet their next ones."""
    met = found.distances[found.elements >= 0]
    scale = share * median(met) if len(met) else math.inf
    return scale if scale > 0.0 else math.inf
