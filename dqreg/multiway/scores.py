"""How far poses of many scans are from the true ones, whichever engine they are of."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud
from dqreg.report.table import Column, Table
from dqreg.rigid import pose
from dqreg.solvers import solve

# Points of a scan that an error is measured on, and errors of a scan that is right: in sizes of a scan.
JUDGING_POINTS, RIGHT_ERROR_SIZES = 1_000, 0.01
# From the increments of two poses to that between them.
DIFFERENCE = np.hstack([-np.eye(6), np.eye(6)])


@dataclasses.dataclass(frozen=True)
class ManyScore:
    """How far an engine's poses are from the true ones, once all scans together were moved to fit them best."""

    engine: str
    placed: int  # Scans with a pose
    right: int  # Scans with an rms error below a hundredth of their size
    rms: float  # Of all points of all placed scans
    worst: float  # Largest rms of a scan
    worst_deg: float  # Largest rotation error of a scan
    seconds: float
    remark: str = ""


def score(name: str, T: FloatArray, truth: FloatArray, clouds: Sequence[PointCloud], size: float) -> ManyScore:
    """Errors of poses after the best common motion of all scans, by the closed form on their points."""
    placed = np.flatnonzero(np.isfinite(T).all(axis=(1, 2)))
    if len(placed) < 2:
        return ManyScore(name, len(placed), 0, np.nan, np.nan, np.nan, np.nan)
    some = [cloud.points[:: max(1, len(cloud.points) // JUDGING_POINTS)] for cloud in clouds]
    there = [pose.apply(T[k], some[k]) for k in placed]
    exact = [pose.apply(truth[k], some[k]) for k in placed]
    common = solve(np.concatenate(there), np.concatenate(exact)).T_target_source
    errors = [pose.apply(common, a) - b for a, b in zip(there, exact, strict=True)]
    each = np.array([np.sqrt((error**2).sum(axis=1).mean()) for error in errors])
    turns = [float(pose.angle_between(common @ T[k], truth[k])) for k in placed]
    return ManyScore(
        name,
        len(placed),
        int((each <= RIGHT_ERROR_SIZES * size).sum()),
        float(np.sqrt(np.concatenate([(error**2).sum(axis=1) for error in errors]).mean())),
        float(each.max()),
        float(np.rad2deg(max(turns))),
        np.nan,
    )


def many_table(scores: Sequence[ManyScore], count: int) -> Table:
    """One row an engine."""
    columns = (
        Column("engine"),
        Column("placed", align="right"),
        Column("right", align="right"),
        Column("rms", align="right"),
        Column("worst scan", align="right"),
        Column("worst rotation", "deg", align="right"),
        Column("time", "s", align="right"),
        Column("remark", wraps=True),
    )
    rows = tuple(
        (s.engine, f"{s.placed}/{count}", f"{s.right}/{count}", s.rms, s.worst, s.worst_deg, s.seconds, s.remark)
        for s in scores
    )
    note = (
        "Errors after the best common motion of all scans, in the unit of the scans; right: within a hundredth of a "
        "scan's size. Peers without a search of their own start at the pairs that dqreg found; their time is without."
    )
    return Table("many", f"{count} scans in one frame", columns, rows, note)


def worst_vertices(T: FloatArray, truth: FloatArray, vertices: FloatArray) -> FloatArray:
    """Largest displacement of a part's vertices by each pose after the best common motion, (n,); NaN where not placed.

    Shapes: T and truth (n, 4, 4), both T_world_scan, truth's world the part's frame; vertices (v, 3).
    """
    found = np.full(len(T), np.nan)
    placed = np.flatnonzero(np.isfinite(T).all(axis=(1, 2)))
    if not len(placed):
        return found
    there = [pose.apply(T[k] @ pose.inverse(truth[k]), vertices) for k in placed]
    common = solve(np.concatenate(there), np.tile(vertices, (len(placed), 1))).T_target_source
    for k, moved in zip(placed, there, strict=True):
        found[k] = np.linalg.norm(pose.apply(common, moved) - vertices, axis=1).max()
    return found


def squared_errors(
    T: FloatArray,
    joint: FloatArray,
    centre: FloatArray,
    truth: FloatArray,
    pairs: Sequence[tuple[int, int]],
    unit: float,
) -> FloatArray:
    """Squared error of each relative pose in units of its covariance (NEES): 6 in the mean where that is right.

    NaN where a scan is not placed or a motion is free. Shapes: T and truth (n, 4, 4), T_world_scan; joint (6 n, 6 n),
    of left increments in the world frame about the centre. The unit, a length as of the part, only scales numbers.
    """
    found, scale = np.full(len(pairs), np.nan), np.r_[np.ones(3), np.full(3, 1.0 / unit)]
    there = pose.from_parts(np.eye(3), -centre)
    for row, (i, j) in enumerate(pairs):
        both = np.r_[6 * i : 6 * i + 6, 6 * j : 6 * j + 6]
        covariance = DIFFERENCE @ joint[np.ix_(both, both)] @ DIFFERENCE.T * np.outer(scale, scale)
        if np.isfinite(covariance).all() and np.isfinite(T[[i, j]]).all():
            change = there @ T[i] @ pose.inverse(truth[i]) @ truth[j] @ pose.inverse(there @ T[j])
            error = pose.log(change) * scale
            found[row] = error @ np.linalg.solve(covariance, error)
    return found
