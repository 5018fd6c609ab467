"""Preparation of a scan: Morton order, spacing, noise, normals."""

from __future__ import annotations

import dataclasses

import numpy as np

from dqreg._records import remember
from dqreg.errors import InputError
from dqreg.geometry.cloud import PointCloud
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.morton import distinct_in_order, in_order
from dqreg.geometry.neighbours import FEW_QUERIES, NeighbourTree
from dqreg.geometry.normals import ScanPlanes, sample_rows
from dqreg.geometry.scan import Scan
from dqreg.geometry.scan_measures import THINNED_POINTS, measure_all, measure_pieces, parts_of

FEWEST_POINTS = 3


def prepare_scan(
    cloud: PointCloud, fitted: int | None = None, surface: CloudSurface | None = None, total: int | None = None
) -> Scan:
    """Order a cloud, measure it, and fit normals.

    Parameters
    ----------
    cloud : PointCloud
        The source as it was read.
    fitted : int, optional
        Points at which planes are fitted, evenly taken along the Morton curve; None fits at all of them. A few are
        fitted to neighbours in an evenly thinned cloud, and spacing and noise are then measured on pieces of it: for
        a large cloud that costs a small part of fitting at all points.
    surface : CloudSurface, optional
        The cloud as a surface, where there is one: its order and its tree are taken.
    total : int, optional
        Points of the cloud that this one was made of. Default: its own.

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
    >>> scan = prepare_scan(PointCloud(grid), fitted=50)
    >>> len(scan), int(scan.directed.sum()), scan.spacing, scan.noise
    (100, 50, 1.0, 0.0)
    """
    return scan_of(cloud, fitted, surface, total, quiet=True)


def scan_of(
    cloud: PointCloud,
    fitted: int | None = None,
    surface: CloudSurface | None = None,
    total: int | None = None,
    *,
    quiet: bool,
) -> Scan:
    """The same; whether the noise of the quieter faces is measured, which nobody asks for between two clouds."""
    given, move = cloud._unmoved
    order = distinct_in_order(given, cloud._ends, move) if surface is None else surface.order
    points = in_order(given, order, move) if surface is None else surface._distinct.points
    if len(points) < FEWEST_POINTS:
        raise InputError(
            f"a scan needs finite points at {FEWEST_POINTS} places at least to fix a pose; the {len(cloud)} points of "
            f"this one are at {len(points)}"
        )
    rows = sample_rows(len(points), len(points) if fitted is None else fitted)
    is_whole = len(rows) == len(points) or len(points) <= THINNED_POINTS
    tree = None
    if is_whole:
        # Points in Morton order need no other order for few queries.
        few = FEW_QUERIES * len(rows) <= len(points)
        tree = NeighbourTree(points, in_order=few) if surface is None else surface._distinct.tree
        of_cells, means = (None, points) if surface is None else (surface._all_planes(), surface._means)
        fits, spacing, noises = measure_all(points, rows, tree, of_cells, means, quiet=quiet)
    else:
        fits, spacing, noises = measure_pieces(points, rows, quiet=quiet)
    planes = ScanPlanes.of(rows, fits, len(points))
    if cloud.normals is None and cloud.viewpoint is not None:
        planes = planes.oriented(points, cloud.viewpoint)
    oriented, total = cloud.normals is not None or cloud.viewpoint is not None, len(points) if total is None else total
    measured = {"oriented": oriented, "spacing": spacing, "noise": noises[0], "quiet": noises[1], "total": total}
    scan = Scan._with(planes, {"points": points, "parts": parts_of(order), **measured})
    if cloud.normals is not None:
        scan = dataclasses.replace(scan, normals=np.take(cloud.normals, order, axis=0))
    remember(scan, diagonal=float(np.linalg.norm(np.subtract(*cloud._ends))))
    return scan if tree is None else remember(scan, tree=tree)
