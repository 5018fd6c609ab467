"""Turns that no step explains: a corridor of equal pilasters fits half a turn on, and may fit better so.

The rings of a LiDAR lie on themselves where the sensor was, turned or not, and hold more points than a pose a step on.
That says nothing of the turn. Faces along the corridor do: where they fit about as well without one, none is believed.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.icp import Alignment
from dqreg.kernels.threads import Later
from dqreg.odometry.align import FrameSearch
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.map_surface import MapSurface
from dqreg.odometry.rivals import (
    MIN_FACING_POINTS,
    ComparedFrame,
    comparison_of,
    faces,
    map_sample,
    normal_scatter,
    share_looked_through,
    shifted,
    weakest,
)
from dqreg.odometry.self_similarity import FrameView
from dqreg.rigid.single_pose import angle_between, log
from dqreg.trust.records import Alternative

# Share of what a turned pose explains from which on another one explains about as much: in a corridor of pilasters the
# right one came to 0.83, and others to 0.14. Of the poses along it those are about as good as the best.
AS_MUCH_SHARE, BEST_SHARE = 2.0 / 3.0, 0.9
# Share of the map in view that a right pose looks through at most: half-turns of furnished halls came to 0.003 and
# beyond; so did 2 of 137 right frames (of a hand-held sensor).
LOOKED_THROUGH_SHARE = 0.002

# Share of the map in view that a frame looked through where it was placed.
Looked = Callable[[Alignment], float]


def looking(surface: MapSurface, view: Later[FrameView]) -> Looked:
    """How much of a map a frame looks through where it is placed."""
    return lambda run: share_looked_through(run, view.result(), map_sample(surface))


def in_a_step(T_expected: FloatArray, T: FloatArray, limit_deg: float) -> FloatArray:
    """A pose that a frame was found at, (4, 4), if it turned no farther than that; else the expected one."""
    return T if np.rad2deg(angle_between(T_expected, T)) <= limit_deg else T_expected


def unturned(
    place: ComparedFrame, search: FrameSearch, frame: DownsampledFrame, T_before: FloatArray, looked: Looked
) -> ComparedFrame:
    """The same, unless the frame turned farther than in a step and a pose that did not explains about as much.

    Then that pose, with the place as its equal. Shifts of where it was found before are compared; one that looks
    through the map, where the place does not, is excluded by what stands there.
    """
    run, scan = place.aligned, frame.fitted
    if not run.found or np.rad2deg(angle_between(T_before, run.T_target_source)) <= search.settings.search_deg:
        return place
    known = np.flatnonzero(scan.normals.any(axis=1))
    about, axis = _turned_about(T_before, run)
    around = known[~faces(scan.normals[known], run, about)]
    facing = around[faces(scan.normals[around], run, axis)]
    if not len(facing):
        return place
    wide, closer = comparison_of(search, scan, around), comparison_of(search, scan, facing)
    shifts, shares = closer.explained(T_before, run.T_target_source, axis)
    # Of those that are about as good the nearest.
    shift = min(shifts[shares >= BEST_SHARE * shares.max()], key=abs)
    again = search.refine(scan, shifted(T_before, shift * axis))
    poses = again.T_target_source, run.T_target_source
    # Few faces along a corridor tell nothing, and so nothing of a turn.
    telling = (wide, closer) if len(facing) >= MIN_FACING_POINTS else (wide,)
    if not again.found or min(each.explained(*poses)[1][0] for each in telling) < AS_MUCH_SHARE:
        return place
    if looked(again) > LOOKED_THROUGH_SHARE and not looked(run) > LOOKED_THROUGH_SHARE:
        return place
    rival = Alternative(run.T_target_source, wide.rms(run.T_target_source))
    axis, share = weakest(again)
    return dataclasses.replace(place, aligned=again, axis=axis, share=share, rivals=(rival, *place.rivals))


def _turned_about(T_before: FloatArray, run: Alignment) -> tuple[FloatArray, FloatArray]:
    """Axis of the turn from a pose to that of a run, and the weakest direction across it, (3,) each, map frame."""
    turn = log(run.T_target_source[:3, :3] @ T_before[:3, :3].T, np.zeros(3))[:3]
    about = turn / np.linalg.norm(turn)
    across = np.eye(3) - np.outer(about, about)
    _, vectors = np.linalg.eigh(across @ normal_scatter(run) @ across - np.outer(about, about))
    return about, np.asarray(vectors[:, 1])
