"""From a raw cloud to a scan that the loop can use: spacing and noise measured, ordered, thinned, with normals."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.errors import InputError
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import fit_planes, orient_towards, sample_rows
from dqreg.geometry.order import distinct_in_order

# Enough for a median that is good to one per cent.
SPACING_SAMPLE = 5_000
FEWEST_POINTS = 3


@dataclasses.dataclass(frozen=True)
class Scan:
    """Source points ready for the loop, in Morton order.

    Attributes
    ----------
    points : ndarray, (n, 3)
        Positions in the source frame.
    normals : ndarray, (n, 3)
        Unit normals; zero where the neighbours fix none. The sign counts only if ``oriented``.
    levers : ndarray, (n,)
        Squared length that turns a point's weight into its normal's (see `PlaneFits`); 0 where there is no normal.
    residuals : ndarray, (n,)
        Local plane residual sigma_r of each point; NaN where unknown.
    oriented : bool
        Whether the normals' signs are known (given, or a viewpoint was).
    spacing : float
        Median distance between nearest neighbours of the whole cloud.
    noise : float
        Median local plane residual: an upper estimate of the point noise where the surface is curved.
    total : int
        Distinct points of the whole cloud.
    """

    points: FloatArray
    normals: FloatArray
    levers: FloatArray
    residuals: FloatArray
    oriented: bool
    spacing: float
    noise: float
    total: int

    def __len__(self) -> int:
        return len(self.points)

    def thinned(self, count: int) -> Scan:
        """The same scan with at most ``count`` points, evenly taken along the Morton curve."""
        rows = sample_rows(len(self), count)
        return dataclasses.replace(
            self,
            points=self.points[rows],
            normals=self.normals[rows],
            levers=self.levers[rows],
            residuals=self.residuals[rows],
        )

    @property
    def diagonal(self) -> float:
        """Diagonal of the bounding box."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def prepare_scan(cloud: PointCloud, most: int | None = None) -> Scan:
    """Order a cloud, measure it, thin it, and fit normals from all of its points.

    Parameters
    ----------
    cloud : PointCloud
        The source as it was read.
    most : int, optional
        Points to keep at most; normals and noise still come from the neighbours in the full cloud. None keeps all.

    Returns
    -------
    Scan
        Ready for the loop.

    Raises
    ------
    InputError
        If fewer than three distinct places are left.

    Examples
    --------
    >>> grid = np.stack(np.meshgrid(range(10), range(10), [0.0]), axis=-1).reshape(-1, 3)
    >>> scan = prepare_scan(PointCloud(grid), most=50)
    >>> len(scan), scan.spacing, scan.noise
    (50, 1.0, 0.0)
    """
    order = distinct_in_order(cloud.points)
    points = cloud.points[order]
    if len(points) < FEWEST_POINTS:
        raise InputError(
            f"a scan needs finite points at {FEWEST_POINTS} places at least to fix a pose; the {len(cloud)} points of "
            f"this one are at {len(points)}"
        )
    tree = NeighbourTree(points)
    rows = sample_rows(len(points), len(points) if most is None else most)
    kept = points[rows]
    fits = fit_planes(tree, points, kept)
    known = np.asarray(np.isfinite(fits.normals).all(axis=1))
    normals = np.where(known[:, None], fits.normals, 0.0)
    if cloud.normals is not None:
        normals = cloud.normals[order][rows]
    elif cloud.viewpoint is not None:
        normals = orient_towards(normals, kept, cloud.viewpoint)
    return Scan(
        points=kept,
        normals=normals,
        levers=np.where(known, fits.lever, 0.0),
        residuals=fits.residuals,
        oriented=cloud.normals is not None or cloud.viewpoint is not None,
        spacing=measure_spacing(tree, points),
        noise=float(np.median(fits.residuals[known])) if known.any() else 0.0,
        total=len(points),
    )


def measure_spacing(tree: NeighbourTree, points: FloatArray) -> float:
    """Median distance from a point to its nearest neighbour that is not a duplicate of it.

    Parameters
    ----------
    tree : NeighbourTree
        Tree of ``points``.
    points : ndarray, (n, 3)
        The cloud.

    Returns
    -------
    float
        The spacing, > 0.

    Raises
    ------
    InputError
        If all points coincide.

    Examples
    --------
    >>> line = np.arange(12.0).reshape(-1, 1) * [2.0, 0.0, 0.0]
    >>> measure_spacing(NeighbourTree(line), line)
    2.0
    """
    sample = points[sample_rows(len(points), SPACING_SAMPLE)]
    _, distances = tree.nearest(sample, 2)
    gaps = distances[:, -1]
    if gaps.max() > 0.0:
        return float(np.median(gaps[gaps > 0.0]))
    # Every sampled point has a twin; only a cloud that is one single place has no spacing at all.
    extent = float(np.linalg.norm(np.ptp(points, axis=0)))
    if extent == 0.0:
        raise InputError(f"all {len(points)} points coincide; a pose needs points at three places at least")
    return extent / len(points)
