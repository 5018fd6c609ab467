"""From believed edges to the final poses: the joint refinement of all placed scans, and its covariance."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.threads import TimeUpError, ask_clock, until
from dqreg.multiway.pose_graph.edges import PART
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.common_planes import PlacedBodies, refine_on_planes
from dqreg.multiway.refinement.joint import refine_jointly
from dqreg.multiway.refinement.spread import beyond_noise, joint_covariance
from dqreg.multiway.scans.overlap import CELL_SIZES, MIN_OVERLAP, overlap_matrix
from dqreg.multiway.scans.scans import View, typical_spacing
from dqreg.registration.options.options import Effort
from dqreg.registration.target import Target
from dqreg.rigid import pose

# Points of a scan in the joint cost.
POINTS_OF_EFFORT: dict[str, int] = {"fast": 5_000, "normal": 20_000, "best": 10**9}
# Points and rounds of pairs alone, before faces are planes in common.
ROUGH_POINTS, MAX_ROUGH_ROUNDS = 2_000, 20
# Edge of the cells whose residuals are independent of the next one's: in spacings, and in sizes of a scan.
PATCH_SPACINGS, PATCH_SIZES = 8.0, 0.02


@dataclasses.dataclass(frozen=True)
class Refined:
    """The poses of all scans, and how sure they are."""

    T_world_scan: FloatArray  # (n, 4, 4): NaN where not placed
    covariance: FloatArray  # (6 n, 6 n): Of left increments in the world frame about the centre
    centre: FloatArray  # (3,): Middle of the placed scans
    converged: bool
    rounds: int
    by_steps: bool = False  # Whether equal steps of a table hold what faces do not
    is_late: bool = False  # Whether there was no time for it: the poses are as the pairs put them


def refined(
    views: Sequence[View],
    known: Sequence[Body | None],
    part: Target | None,
    T_world_scan: FloatArray,
    anchor: int,
    size: float,
    effort: Effort,
    *,
    on_table: bool = False,
    deadline: float = np.inf,
) -> Refined:
    """Refine all placed scans, and whatever else overlaps, at once; there is a body for each usable scan.

    The pose of the anchor, a scan or -1 for the part, is kept. Steps of a table hold what faces do not. After the
    deadline, of `time.perf_counter`, the poses are given back. Shapes: T_world_scan (n, 4, 4), NaN where not placed.
    """
    with suppress(TimeUpError), until(deadline):
        ask_clock()
        return _refined(views, known, part, T_world_scan, anchor, size, effort, on_table=on_table)
    return dataclasses.replace(_unrefined(T_world_scan), is_late=True)


def _unrefined(T_world_scan: FloatArray) -> Refined:
    unknown = np.full((6 * len(T_world_scan), 6 * len(T_world_scan)), np.nan)
    return Refined(T_world_scan, unknown, np.zeros(3), converged=False, rounds=0)


def _refined(
    views: Sequence[View],
    known: Sequence[Body | None],
    part: Target | None,
    T: FloatArray,
    anchor: int,
    size: float,
    effort: Effort,
    *,
    on_table: bool,
) -> Refined:
    count = len(views)
    placed = [k for k in range(count) if views[k].usable and np.isfinite(T[k]).all()]
    bodies = [body for k in placed if (body := known[k]) is not None]
    poses = [T[k] @ _shift(body.origin) for k, body in zip(placed, bodies, strict=True)]
    pairs = _pairs(views, placed, T, size)
    held = placed.index(anchor) if anchor in placed else -1
    if part is not None and anchor == PART:
        index = part.indexed
        bodies.append(Body(None, index.surface, index.origin))
        poses.append(_shift(index.origin))
        pairs += [(len(placed), k) for k in range(len(placed))]
        held = len(placed)
    free = np.array([k for k in range(len(bodies)) if k != held], dtype=np.int64)
    if not pairs or len(placed) < 1:
        return _unrefined(T)
    spacing = typical_spacing([views[k] for k in placed])
    T_begun = np.array(poses)
    rough = refine_jointly(bodies, T_begun, pairs, free, ROUGH_POINTS, most=MAX_ROUGH_ROUNDS)
    usable = [k for k in range(count) if views[k].usable]
    table = ([usable.index(k) for k in placed], len(usable)) if on_table else None
    found_by = refine_on_planes(bodies, rough.T_world_body, free, spacing, size, table)
    if found_by is None:
        cell = max(PATCH_SPACINGS * spacing, PATCH_SIZES * size)
        found_by = _by_pairs(bodies, T_begun, pairs, free, len(placed), POINTS_OF_EFFORT[effort], cell, size)
    found = np.full((count, 4, 4), np.nan)
    for k, body, T_world_body in zip(placed, bodies, found_by.T_world_body, strict=False):
        found[k] = T_world_body @ _shift(-body.origin)
    rows = np.concatenate([6 * placed[k] + np.arange(6) for k in free if k < len(placed)] or [np.zeros(0, int)])
    kept = np.concatenate([6 * n + np.arange(6) for n, k in enumerate(free) if k < len(placed)] or [np.zeros(0, int)])
    covariance = np.full((6 * count, 6 * count), np.nan)
    for k in placed:
        covariance[6 * k : 6 * k + 6, [c for p in placed for c in range(6 * p, 6 * p + 6)]] = 0.0
    covariance[np.ix_(rows, rows)] = found_by.covariance[np.ix_(kept, kept)]
    return Refined(found, covariance, found_by.centre, found_by.converged, found_by.rounds, found_by.by_steps)


def _by_pairs(
    bodies: Sequence[Body],
    T: FloatArray,
    pairs: Sequence[tuple[int, int]],
    free: IntArray,
    scans: int,
    points: int,
    cell: float,
    size: float,
) -> PlacedBodies:
    joint = refine_jointly(bodies, T, pairs, free, points)
    centre = np.mean(joint.T_world_body[:scans, :3, 3], axis=0)
    about = _shift(-centre) @ joint.T_world_body
    if not joint.planes:
        unknown = np.full((6 * len(free), 6 * len(free)), np.nan)
        return PlacedBodies(joint.T_world_body, unknown, centre, joint.rounds, converged=False)
    spread = joint_covariance(about, joint.planes, free, cell, size)
    # Doubtful correspondences (blends of two faces, places that only one of two scans sees) bias motions that little
    # else holds. What the poses change by without them, beyond what noise does, is an error that no scatter shows.
    strict = refine_jointly(bodies, joint.T_world_body, pairs, free, points, strict=True)
    found = PlacedBodies(joint.T_world_body, spread.covariance, centre, joint.rounds, joint.converged)
    if not strict.planes:
        return found
    moved = _shift(-centre) @ strict.T_world_body
    change = pose.log(moved @ pose.inverse(about))[free]
    biases = beyond_noise(change, spread, joint_covariance(moved, strict.planes, free, cell, size)).ravel()
    return dataclasses.replace(found, covariance=spread.covariance + np.outer(biases, biases))


def _pairs(views: Sequence[View], placed: Sequence[int], T: FloatArray, size: float) -> list[tuple[int, int]]:
    overlap = np.nan_to_num(overlap_matrix(views, T, size, CELL_SIZES))
    n = len(placed)
    return [(a, b) for a in range(n) for b in range(a + 1, n) if overlap[placed[a], placed[b]] >= MIN_OVERLAP]


def _shift(offset: FloatArray) -> FloatArray:
    return pose.from_parts(np.eye(3), offset)
