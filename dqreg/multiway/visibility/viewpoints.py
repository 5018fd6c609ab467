"""Where the scanner of each scan stood: given, or the one line of sight that serves all scans."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry import Scan
from dqreg.multiway.scans.scans import View, every_so_many
from dqreg.trust.free_space import MAX_HIDDEN_FROM_ORIGIN

# Directions that are tried, and points of a scan that are looked at.
TRIED_DIRECTIONS, POINTS_PER_SCAN = 150, 3_000
# Scans of a turntable that are looked at.
MAX_TABLE_SCANS = 12
# Edge of a pixel in spacings; a point is behind another that is so many pixels nearer.
PIXEL_SPACINGS, HIDDEN_DEPTH_PIXELS = 2.0, 4.0
# Cosine below which a face is seen at a grazing angle.
GRAZING_COS = 0.1
# Distance of a likely viewpoint in sizes of the scan.
VIEWPOINT_DISTANCE_SIZES = 3.0


@dataclasses.dataclass(frozen=True)
class Viewpoint:
    """Where a scanner stood, in the centred frame of its scan."""

    place: FloatArray  # (3,)
    certain: bool  # Given, or told by pairs: else a direction alone, forwards or backwards for all scans


Viewpoints = tuple[Viewpoint | None, ...]


def given_viewpoints(views: Sequence[View]) -> Viewpoints:
    """Where each scan says that it was taken from; None where it does not."""
    return tuple(_given(view) for view in views)


def common_viewpoints(views: Sequence[View]) -> tuple[Viewpoints, Viewpoints] | None:
    """Places in one direction of all scans, and in the opposite one, that none of them speaks against.

    On a turntable, and before one camera, the scanner stands still, and all scans are in its frame: one direction from
    which no point hides another serves all of them. Its sign is open, and the same for all, which is enough to compare
    sides.
    """
    usable = [k for k, view in enumerate(views) if view.usable]
    if any(_given(views[k]) is not None for k in usable):
        return None
    sight = _line_of_sight([views[k] for k in usable[:: max(1, len(usable) // MAX_TABLE_SCANS)]])
    return None if sight is None else (_along(views, sight), _along(views, -sight))


def _along(views: Sequence[View], sight: FloatArray) -> Viewpoints:
    return tuple(
        Viewpoint(view.scan.points.mean(axis=0) + VIEWPOINT_DISTANCE_SIZES * view.scan.diagonal * sight, certain=False)
        if view.usable
        else None
        for view in views
    )


def _given(view: View) -> Viewpoint | None:
    place = None if view.cloud is None or not view.usable else view.cloud.viewpoint
    return None if place is None else Viewpoint(place - view.origin, certain=True)


def _line_of_sight(views: Sequence[View]) -> FloatArray | None:
    """Direction from which no point of any scan hides another and few faces are seen at a grazing angle."""
    k = np.arange(TRIED_DIRECTIONS) + 0.5
    height, turn = 1.0 - k / TRIED_DIRECTIONS, k * np.pi * (1.0 + 5.0**0.5)
    flat = np.sqrt(1.0 - height**2)
    directions = np.column_stack([flat * np.cos(turn), flat * np.sin(turn), height])
    hidden = np.array([np.mean([_hidden(view.scan, d) for view in views], axis=0) for d in directions])
    best = int(hidden.sum(axis=1).argmin())
    return directions[best] if hidden[best, 0] <= MAX_HIDDEN_FROM_ORIGIN else None


def _hidden(scan: Scan, direction: FloatArray) -> tuple[float, float]:
    """Shares of the points behind others, and on faces seen at a grazing angle."""
    points, normals = (every_so_many(rows, POINTS_PER_SCAN) for rows in (scan.points, scan.normals))
    across = np.linalg.svd(direction[None])[2][1:]
    pixel = PIXEL_SPACINGS * scan.spacing * np.sqrt(len(scan.points) / len(points))
    cells = np.floor(points @ across.T / pixel).astype(np.int64)
    cells -= cells.min(axis=0)
    rows = cells[:, 0] * (cells[:, 1].max() + 1) + cells[:, 1]
    depth = points @ direction
    nearest = np.full(int(rows.max()) + 1, -np.inf)
    np.maximum.at(nearest, rows, depth)
    return (
        float(np.mean(nearest[rows] - depth > HIDDEN_DEPTH_PIXELS * pixel)),
        float(np.mean(np.abs(normals @ direction) < GRAZING_COS)),
    )
