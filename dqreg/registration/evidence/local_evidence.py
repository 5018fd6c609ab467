"""What the neighbourhoods of a scan's points say at a pose: strays, normals that disagree, noise."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._arrays import BoolArray, FloatArray, median, quantile, root_mean_square
from dqreg._records import replaced
from dqreg.geometry import CloudSurface, Scan, Surface
from dqreg.geometry.cells import CellSurface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.vector_rows import nonzero_rows, row_dots
from dqreg.icp import Alignment, Correspondences, smallest_kernel_scale
from dqreg.icp.coarse_to_fine import noise_on
from dqreg.registration.evidence.even_correspondences import fitted_pairs
from dqreg.rigid import pose
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.trust.limits import DISAGREEING_NORMAL_SHARE
from dqreg.trust.neighbourhoods import DISAGREEING_COS, MAX_ROUGHNESS, Neighbourhoods, apart_in_cells

# Standard deviations of the distances, in the scan's own noise, beyond which that is estimated once more and another
# pose is searched for: of 2,000 right poses none came above 1.4, walls settled on their wrong side to 2.4 and more.
MISFIT = 2.0
# Neighbourhoods rougher than this, in their extent, are no surface at all.
ROUGH = 0.4
# A scan whose noise is large against its spacing is rough everywhere: strays are rougher by this factor.
MORE_THAN_USUAL = 2.5
# Cells of two clouds that are heard against the normals of their points disagree no more than this. Right poses of
# noisy parts and depth images came to 0.002, one of two rooms to 0.08; wrong ones to 0.02 and more, some to 0. That
# none disagrees speaks for no pose: all else that the verdict asks is asked still.
HARDLY = 0.01


@dataclasses.dataclass(frozen=True)
class LocalEvidence:
    """What the neighbourhoods of the points say."""

    strays: float
    normals_apart: float
    noise: float  # Distances of points from the planes of their neighbours

    @staticmethod
    def at_end(
        run: Alignment,
        scan: Scan,
        surface: Surface,
        pairs: Correspondences,
        width: float,
        *,
        has_border: bool,
        given_normals: bool,
    ) -> LocalEvidence:
        """That at the end of a run: where it is against the pose, asked of what it would be on the target."""
        # From cloud to cloud the tangent planes are guesses between points that stand apart.
        floor = scan.spacing if has_border else smallest_kernel_scale(scan, surface)
        fitted = pairs
        if scan.fitted is not None and len(pairs.scan) < len(scan):
            fitted = fitted_pairs(run, scan, scan.fitted, surface, run.mixture.scale)
        local = LocalEvidence.of(fitted, width)
        local = replaced(local, noise=max(min(local.noise, noise_on(scan, surface)), floor))
        is_apart = local.normals_apart > DISAGREEING_NORMAL_SHARE
        if isinstance(surface, CloudSurface):
            is_asked = is_apart and not given_normals
            return local._in_cells(scan, surface, pairs, width) if is_asked else local
        return local._on_target(pairs, width, is_apart=is_apart and not pairs.scan.oriented)

    def _in_cells(self, scan: Scan, surface: CloudSurface, pairs: Correspondences, width: float) -> LocalEvidence:
        """The same where the normals of two clouds' cells agree, which noise turns less; they have no sign."""
        apart = apart_in_cells(scan.points, surface._distinct.points, pairs.T_target_source, width)
        if not apart <= HARDLY and isinstance(surface, CellSurface) and surface.in_rings:
            apart = _apart_on_source(scan, surface, pairs.T_target_source, width)
        if not apart <= HARDLY:
            return self
        return replaced(self, normals_apart=float(np.fmax(apart, pairs.looking_away(width))))

    def _on_target(self, pairs: Correspondences, width: float, *, is_apart: bool) -> LocalEvidence:
        """The same where points are rougher than their noise, or normals apart, and the feet tell why."""
        on = pairs.distances <= width
        aside = pairs.point_to_plane[on]
        is_rough = len(aside) > 0 and root_mean_square(aside) > MISFIT * self.noise
        if not (is_apart or is_rough):
            return self
        usual = GAUSSIAN_MEDIAN * median(np.abs(aside))
        again = Neighbourhoods.of(pairs.moved, pairs.closest.points, pairs.closest.normals, on, usual)
        apart = float(np.fmin(self.normals_apart, again.apart)) if is_apart else self.normals_apart
        return replaced(self, normals_apart=apart, noise=float(np.fmax(self.noise, again.noise)))

    @staticmethod
    def of(pairs: Correspondences, width: float) -> LocalEvidence:
        """That of correspondences, of those within a width as inliers."""
        scan, found = pairs.scan, pairs.closest
        # Other points have no neighbourhood.
        rows, own, levers, residuals = scan._fitted_planes
        normals = found.normals[rows]
        on, known = found.distances[rows] <= width, np.isfinite(residuals)
        with np.errstate(divide="ignore", invalid="ignore"):
            # How far the neighbours leave their plane, in their own extent: no length in it.
            rough = np.minimum(residuals / np.sqrt(levers), np.finfo(float).max)
        rough[np.isnan(rough)] = np.inf
        compared = (rough < MAX_ROUGHNESS) & on & nonzero_rows(normals)
        cosines = row_dots(normals @ pairs.T_target_source[:3, :3], own)
        cosines = cosines if pairs.same_sign else np.abs(cosines)
        # Among strays many neighbourhoods hold one; the better part of them is the sensor's own.
        flat = rough[on & np.isfinite(rough)]
        usual = quantile(flat, 0.3) if len(flat) else 0.0
        return LocalEvidence(
            strays=share((rough > max(ROUGH, MORE_THAN_USUAL * usual)) & ~on, known),
            normals_apart=share(cosines < DISAGREEING_COS, compared),
            noise=quantile(residuals[on & known], 0.3) if (on & known).any() else np.inf,
        )


def _apart_on_source(scan: Scan, surface: CloudSurface, T_target_source: FloatArray, width: float) -> float:
    """Share of the target's neighbourhoods whose normal is neither the source's nor that of their feet on it.

    Through two rings of a LiDAR a plane always goes, if one is on a floor and one on the wall beyond it too: it fits as
    well as any, and stands across both. On a source that is dense there the feet of its points make the same plane.
    """
    rows = scan._fitted_planes[0]
    points, normals = scan.points[rows], scan._fitted_planes[1]
    stands = pose.apply(pose.inverse(T_target_source), surface._distinct.points)
    nearest, distances = NeighbourTree(points).nearest(stands, 1)
    own = np.nan_to_num(normals[nearest[:, 0]])
    aside = row_dots(stands - points[nearest[:, 0]], own)
    on = (distances[:, 0] <= width) & nonzero_rows(own)
    usual = GAUSSIAN_MEDIAN * median(np.abs(aside[on])) if on.any() else 0.0
    return Neighbourhoods.of(stands, stands - aside[:, None] * own, own, on, usual).apart


def share(part: BoolArray, whole: BoolArray) -> float:
    """Share of the one among the other, both (n,); 0 of none."""
    count = int(np.count_nonzero(whole))
    return float(np.count_nonzero(part & whole)) / count if count else 0.0
