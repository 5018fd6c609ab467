"""What the points of a scan lie on that are not on the target: other objects, or surface of the part itself."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from dqreg._arrays import BoolArray, share_of
from dqreg.geometry import Surface
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.icp import Correspondences
from dqreg.search.problem import SCENE_RATIO
from dqreg.trust.limits import MIN_NOISE_DIAGONALS
from dqreg.trust.patch_tests import share_displaced
from dqreg.trust.segments import Segments, segments_of, share_going_on

# Points of which segments are made, and the share of points off the target from which it is asked what they are.
SEGMENTED, SOME_OFF = 5_000, 0.02
# Points are off the target together beyond so many standard deviations of the noise.
TOGETHER = 5.0


@dataclasses.dataclass(frozen=True)
class Surroundings:
    """What the points of a scan lie on, as shares of all; the rest is on edges, on no surface or hardly off."""

    elsewhere: BoolArray  # (n,): Points of objects that reach far from the target
    share_on: float  # On the target
    share_other: float  # On other objects
    share_contradicting: float  # On surface of the part itself, off the target
    share_on_faces: float  # On smooth surface that is on the target
    going_on: float = math.nan  # Of a scan larger than the target: see `share_going_on`


def surroundings_of(pairs: Correspondences, width: float, near: float, size: float) -> Surroundings:
    """What the points lie on, where the target is closed, of a size; within a width they are on it.

    Objects that reach farther than ``near`` with most of their points are no part of it.
    """
    on = pairs.distances <= width
    nowhere = np.zeros(len(on), dtype=bool)
    if (share_on := share_of(on)) >= 1.0 - SOME_OFF:
        return Surroundings(nowhere, share_on, 0.0, 0.0, math.nan)
    rows = sample_rows(len(on), SEGMENTED)
    points, distances = pairs.moved[rows], pairs.distances[rows]
    segments = segments_of(points, pairs.closest.normals[rows], distances, width, size)
    far = _far_objects(segments, distances > near)
    # Points between two segments go with the nearest one.
    known = np.flatnonzero(segments.labels >= 0)
    elsewhere = nowhere
    if far.any():
        elsewhere = ~on & far[known][NeighbourTree(points[known]).nearest(pairs.moved, 1)[0][:, 0]]
    faces = segments.on & (segments.labels >= 0)
    on_target, other, wrong, on_faces = (
        share_of(side) for side in (segments.on, segments.other, segments.contradicting, faces)
    )
    is_larger = pairs.scan.diagonal > SCENE_RATIO * size
    asked = pairs.moved, pairs.closest.normals, pairs.distances
    going_on = share_going_on(*asked, width, size) if is_larger else math.nan
    return Surroundings(elsewhere, on_target, other, wrong, on_faces, going_on)


def displaced_of(
    pairs: Correspondences, close: BoolArray, width: float, noise: float, surface: Surface, ratio: float
) -> float:
    """Share of the points near a part, (n,), on faces that lie beside their places, beyond a width of those on it.

    0 for a scan larger than the part, of which other objects may be as even. Made parts deviate by a ratio more.
    """
    if pairs.scan.diagonal > SCENE_RATIO * surface.diagonal:
        return 0.0
    noise = max(noise, MIN_NOISE_DIAGONALS * surface.diagonal * ratio)
    off = pairs.distances[close] > max(TOGETHER * noise, width)
    if not off.any():
        return 0.0
    return share_displaced(pairs.moved[close], pairs.closest.normals[close], off, noise)


def _far_objects(segments: Segments, far: BoolArray) -> BoolArray:
    """Points of other objects of which most points are far, (n,)."""
    known = segments.labels >= 0
    count, of_far, wrong = (
        np.bincount(segments.labels[known], side[known].astype(float))
        for side in (np.ones_like(far), far, segments.contradicting)
    )
    objects = (of_far > 0.5 * count) & (wrong == 0.0)
    return np.asarray(known & np.append(objects, False)[segments.labels])
