"""Joint refinement: the planes of all overlapping pairs in one cost, and all poses at once.

The cost of a pair is a quadratic form of its relative pose, additive over correspondences: 13x13 numbers stand for all
of them while the poses are solved for. The answer is the one of most likelihood for all correspondences together, not
for summaries of pairs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.geometry import Scan
from dqreg.multiway import dual_poses
from dqreg.multiway.graph import PoseGraph, factorised, normal_matrix
from dqreg.multiway.planes import FACING, STRICT, Body, Planes, planes_of
from dqreg.rigid import pose
from dqreg.solvers.quadratic import derivatives

# Rounds of new correspondences, and steps for each.
ROUNDS, STRICT_ROUNDS, STEPS = 25, 6, 4
# The refinement has ended when the scans move by less than this in a round, in spacings; and it has converged when they
# move by less than the second number in the last round: nearest points change from round to round.
STILL, SETTLED = 1e-4, 0.02
# Points a direction of a pair: all pairs together have so many, and each at least the second number.
ALL_POINTS, FEWEST_POINTS = 4_000_000, 500
# Largest distance of a correspondence: in spacings, in scales of the distances of the round before, and at first in
# times the first number.
REACH, NARROW, WIDEST = 2.0, 5.0, 2.0
# The first rounds are with so many times fewer points, until the scans move by less than this in a round, in spacings.
COARSER, COARSE_STILL = 8, 0.03


@dataclasses.dataclass(frozen=True)
class Joint:
    """All poses and the correspondences that they rest on."""

    T_world_body: FloatArray  # (n, 4, 4): Of the centred frames
    planes: tuple[Planes, ...]  # One a direction of a pair
    rounds: int
    converged: bool


def refine_jointly(
    bodies: Sequence[Body],
    T_world_body: FloatArray,
    pairs: Sequence[tuple[int, int]],
    free: IntArray,
    points: int,
    observe: Callable[[int, float], object] | None = None,
    is_over: Callable[[], bool] = lambda: False,
    strict: bool = False,
) -> Joint:
    """Poses of the bodies with the least cost over all pairs (target, source), by Gauss-Newton steps.

    The part, a body without points, is the target only. Strict asks for half of the reach and for normals that agree
    closely: what that changes in poses that are refined already hangs on doubtful correspondences.

    Shapes: T_world_body (n, 4, 4).
    """
    ways = [way for i, j in pairs for way in ((i, j), (j, i)) if bodies[way[1]].scan is not None]
    budget = int(np.clip(ALL_POINTS // max(len(ways), 1), FEWEST_POINTS, points))
    few = max(budget // COARSER, FEWEST_POINTS)
    sampled = {j: _thinned(bodies[j], few) for _, j in ways}
    T = T_world_body.copy()
    found: dict[tuple[int, int], Planes] = {}
    rounds, moved, coarse = 0, np.inf, few < budget and not strict
    if strict:
        sampled = {j: _thinned(bodies[j], budget) for _, j in ways}
    while rounds < (STRICT_ROUNDS if strict else ROUNDS) and moved >= STILL and not is_over():
        rounds += 1
        if coarse and (moved < COARSE_STILL or rounds > ROUNDS // 2):
            coarse, sampled = False, {j: _thinned(bodies[j], budget) for _, j in ways}
        found = _correspond(bodies, sampled, T, ways, found, first=rounds == 1, strict=strict)
        before = T
        for _ in range(STEPS):
            T, motion = _stepped(T, list(found.values()), free)
            if motion < STILL * 0.1:
                break
        moved = _motion(bodies, sampled, before, T)
        if observe is not None and observe(rounds, moved) is False:
            break
    return Joint(T, tuple(found.values()), rounds, moved < SETTLED)


def _thinned(body: Body, count: int) -> Scan:
    assert body.scan is not None
    return body.scan.thinned(count)


def _correspond(
    bodies: Sequence[Body],
    sampled: dict[int, Scan],
    T: FloatArray,
    ways: Sequence[tuple[int, int]],
    before: dict[tuple[int, int], Planes],
    *,
    first: bool,
    strict: bool,
) -> dict[tuple[int, int], Planes]:
    found = {}
    for i, j in ways:
        known = before.get((i, j))
        if known is None and not first:
            continue
        relative = pose.inverse(T[i]) @ T[j]
        floor = max(bodies[i].noise_floor, bodies[j].noise_floor)
        reach = _reach(bodies, i, j, known)
        gates = (0.5 * reach, STRICT) if strict else (reach, FACING)
        planes = planes_of((i, j), sampled[j], bodies[i], relative, gates[0], floor, known, gates[1])
        if planes is not None:
            found[i, j] = planes
    return found


def _reach(bodies: Sequence[Body], i: int, j: int, known: Planes | None) -> float:
    spacing = max(scan.spacing for scan in (bodies[i].scan, bodies[j].scan) if scan is not None)
    widest = WIDEST * REACH * spacing
    return widest if known is None else float(np.clip(NARROW * known.sigma, REACH * spacing, widest))


def linearised(T: FloatArray, planes: Sequence[Planes]) -> tuple[PoseGraph, FloatArray, FloatArray]:
    """The cost about the poses, as a graph of pairs: slopes and curvatures by increments in the world frame.

    Shapes: slopes (m, 6), curvatures (m, 6, 6).
    """
    targets = np.array([each.target for each in planes], dtype=np.int64)
    sources = np.array([each.source for each in planes], dtype=np.int64)
    relative = pose.inverse(T[targets]) @ T[sources]
    forms = [each.form for each in planes]
    slopes = [derivatives(form, Z) for form, Z in zip(forms, relative, strict=True)]
    centres = np.array([form.origin_target for form in forms])
    # The cost is half of the form: a squared distance over its variance.
    information = 0.5 * np.array([squares for _, _, squares in slopes])
    graph = PoseGraph(len(T), targets, sources, relative, information, centres)
    B = graph.jacobians(T)
    pull = np.einsum("mji,mj->mi", B, 0.5 * np.array([gradient for gradient, _, _ in slopes]))
    return graph, pull, B.transpose(0, 2, 1) @ information @ B


def _stepped(T: FloatArray, planes: Sequence[Planes], free: IntArray) -> tuple[FloatArray, float]:
    middle = pose.from_parts(np.eye(3), -np.mean(T[:, :3, 3], axis=0))
    T = middle @ T
    graph, pull, blocks = linearised(T, planes)
    gradient = np.zeros((len(T), 6))
    np.add.at(gradient, graph.sources, pull)
    np.add.at(gradient, graph.targets, -pull)
    step = factorised(normal_matrix(graph, blocks), free).solve(-gradient[free].ravel()).reshape(-1, 6)
    moved = T.copy()
    moved[free] = dual_poses.to_matrices(dual_poses.multiply(dual_poses.exp(step), dual_poses.from_matrices(T[free])))
    return pose.inverse(middle) @ moved, float(np.abs(step[:, :3]).max(initial=0.0))


def _motion(bodies: Sequence[Body], sampled: dict[int, Scan], before: FloatArray, after: FloatArray) -> float:
    """Largest motion of the corners of a scan, in spacings."""
    largest = 0.0
    for k, scan in sampled.items():
        half = 0.5 * bodies[k].surface.diagonal
        change = after[k] - before[k]
        moved = np.linalg.norm(change[:3, 3]) + half * np.linalg.norm(change[:3, :3], 2)
        largest = max(largest, float(moved) / scan.spacing)
    return largest
