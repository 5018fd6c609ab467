"""Places near where a frame is expected, which are tried before all of the map is searched.

A frame that is lost is seldom far away: a sensor was knocked, or a few frames are missing. A lattice of places and
rotations around where it was last, and where its motion would have brought it, takes a tenth of a global search.
"""

from __future__ import annotations

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.icp import Alignment
from dqreg.odometry.align import LATTICE_DEG, LATTICE_STEP_DEG, FrameSearch
from dqreg.odometry.frame import DownsampledFrame
from dqreg.odometry.rivals import shift_between
from dqreg.odometry.starts import best_poses, turns
from dqreg.odometry.unseen_rotations import AS_GOOD_SHARE, MET_SHARE, equal_turns, likely
from dqreg.rigid import single_pose

# Radius of the lattice and its step, in largest distances of a pair.
RADIUS_REACHES, STEP_REACHES = 3.0, 1.0
# Poses that are judged by few points and by many, and the distinct ones of these that a few points are run from.
LATTICE_SHORTLIST, COARSE_RUNS = (180, 60), 12
# Poses are distinct that are so many steps of the lattice apart.
APART_STEPS = 0.8


def place_nearby(search: FrameSearch, frame: DownsampledFrame) -> FloatArray | None:
    """The only pose around the anchors where a frame fits about as usual, (4, 4); None where there is none."""
    scan = search.scan_of(frame)
    runs = likely([search.approach(scan, start) for start in _starts(search, frame)])
    best = max(runs, key=lambda run: run.inlier_fraction, default=None)
    if best is None or _is_one_of_several(search, frame, best, runs):
        return None
    found = search.settle(scan, best.T_target_source, best, anew=True)
    if not found.found or not found.inlier_fraction >= MET_SHARE * search.usual:
        return None
    there = FrameSearch(search.surface, search.lengths, search.settings, np.nan, [(found.T_target_source,) * 2])
    return None if equal_turns(there, frame) else found.T_target_source


def _is_one_of_several(search: FrameSearch, frame: DownsampledFrame, best: Alignment, runs: list[Alignment]) -> bool:
    """Whether a frame ends at another place with about as many inliers."""
    near, spread = 0.5 * search.lengths.reach, frame.scan._spread
    return any(
        run.inlier_fraction >= AS_GOOD_SHARE * best.inlier_fraction
        and spread.motion(run.T_target_source, best.T_target_source) > near
        for run in runs
    )


def _starts(search: FrameSearch, frame: DownsampledFrame) -> list[FloatArray]:
    """The likeliest poses of the lattice that are distinct."""
    reach, kept = search.lengths.reach, list[FloatArray]()
    poses = np.concatenate([_lattice(T, reach) for T in _centres(search)])
    apart, apart_rad = APART_STEPS * STEP_REACHES * reach, np.deg2rad(APART_STEPS * LATTICE_STEP_DEG)
    for T in best_poses(search.surface, frame.seen, poses, 0.5 * reach, LATTICE_SHORTLIST):
        if all(shift_between(T, one) > apart or single_pose.angle_between(T, one) > apart_rad for one in kept):
            kept.append(T)
        if len(kept) == COARSE_RUNS:
            break
    return kept


def _centres(search: FrameSearch) -> list[FloatArray]:
    """Poses that the lattice is laid around: those of the anchors, each place once."""
    kept = list[FloatArray]()
    for T in (T for anchor in search.anchors for T in anchor):
        if all(shift_between(T, other) > search.lengths.reach for other in kept):
            kept.append(T)
    return kept


def _lattice(T: FloatArray, reach: float) -> FloatArray:
    """A pose with all turns of a lattice at all places of another, (n, 4, 4)."""
    count, step = int(RADIUS_REACHES / STEP_REACHES), STEP_REACHES * reach
    along = step * np.arange(-count, count + 1)
    places = np.stack(np.meshgrid(along, along, along, indexing="ij"), axis=-1).reshape(-1, 3)
    places = places[np.linalg.norm(places, axis=1) <= RADIUS_REACHES * reach]
    turned = T @ turns(LATTICE_DEG, LATTICE_STEP_DEG)
    poses = np.repeat(turned, len(places), axis=0)
    poses[:, :3, 3] += np.tile(places, (len(turned), 1))
    return poses
