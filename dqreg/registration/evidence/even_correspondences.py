"""Correspondences of points that were drawn evenly from a scan, at the pose of a run: what evidence is measured on."""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Scan, Surface
from dqreg.geometry.normals import sample_rows
from dqreg.geometry.vector_rows import row_dots
from dqreg.icp import Correspondences, Run, find_correspondences, propagate
from dqreg.rigid import single_pose

# Points that are looked at, evenly over the scan.
EVEN_POINTS = 10_000
# Where the loop has asked about enough of them, those, and of those with a normal of their own.
MIN_ASKED_POINTS, MIN_ASKED_NORMALS = 3_000, 1_000
# The same where the time is up; so many of those that the loop has asked about are enough then.
LATE_POINTS, MIN_ASKED_POINTS_LATE = 1_000, 500
# Where no point has moved by more than that many widths since it was asked about, nothing here can tell; by more than
# so many, a point may be on another face.
UNMOVED_WIDTHS, SAME_FACE_WIDTHS = 0.1, 1.0


def evenly_asked(run: Run, scan: Scan, surface: Surface, width: float, count: int = EVEN_POINTS) -> Correspondences:
    """Pairs at the end of a run of points that were drawn evenly, each of one point: of all that it has, or of some."""
    enough = MIN_ASKED_POINTS if count == EVEN_POINTS else MIN_ASKED_POINTS_LATE
    for asked in (run.pairs, *run.earlier[::-1]):
        drawn_evenly = asked.scan.counts is None and (len(asked.scan) == len(scan) or asked is not run.pairs)
        if drawn_evenly and enough <= len(asked.scan):
            # Of one level all points were asked about, and they are many.
            many = len(asked.scan) > EVEN_POINTS
            some = asked.taken(sample_rows(len(asked.scan), EVEN_POINTS)) if many else asked
            return _again(some, surface, run.T_target_source, width)
    # Thinning for the loop keeps the points with normals; here any will do.
    return find_correspondences(scan.taken(sample_rows(len(scan), count)), surface, run.T_target_source)


def _again(asked: Correspondences, surface: Surface, T: FloatArray, width: float) -> Correspondences:
    # The last pose is no farther off than a step: most faces and points are still the closest.
    moved = single_pose.apply(T, asked.scan.points) - asked.moved
    farthest = float(np.sqrt(row_dots(moved, moved).max(initial=0.0)))
    if farthest <= UNMOVED_WIDTHS * width:
        return asked
    return (
        propagate(asked, T)
        if farthest <= SAME_FACE_WIDTHS * width
        else find_correspondences(asked.scan, surface, T, asked)
    )


def fitted_pairs(run: Run, scan: Scan, fitted: IntArray, surface: Surface, width: float) -> Correspondences:
    """Pairs of points that have a normal of their own."""
    least = min(MIN_ASKED_NORMALS, len(fitted))
    for asked in run.earlier[::-1]:
        if asked.scan.fitted is not None and len(asked.scan) == len(asked.scan.fitted) >= least:
            return _again(asked, surface, run.T_target_source, width)
    return find_correspondences(scan.taken(fitted).thinned(EVEN_POINTS), surface, run.T_target_source)
