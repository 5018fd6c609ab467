"""Joint refinement: the planes of all overlapping pairs in one cost, and all poses at once.

The cost of a pair is a quadratic form of its relative pose, additive over correspondences: 13x13 numbers stand for all
of them while the poses are solved for. The answer is the one of most likelihood for all correspondences together, not
for summaries of pairs.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.kernels.threads import ask_clock
from dqreg.multiway.pose_graph import dual_poses
from dqreg.multiway.pose_graph.graph import PoseGraph, factorised, normal_matrix
from dqreg.multiway.refinement.acceleration import JointAnderson
from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.matches import Matching
from dqreg.multiway.refinement.planes import WeighedMatches, planes_of
from dqreg.rigid import pose
from dqreg.solvers.quadratic import derivatives

# Rounds of new correspondences.
MAX_ROUNDS, MAX_STRICT_ROUNDS = 60, 6
STEPS_PER_ROUND = 3
# The refinement has ended when the scans move by less than this in a round, in spacings; and it has converged when they
# move by less than the second number in the last round: nearest points change from round to round.
STILL_SPACINGS, CONVERGED_SPACINGS = 1e-3, 0.02
# There it has ended too when so many rounds brought no less.
STALLED_ROUNDS = 4
# Points a direction of a pair: all pairs together have so many, and each at least the second number.
MAX_POINTS, MIN_POINTS_PER_DIRECTION = 4_000_000, 500
# Largest distance of a correspondence: in spacings, and in scales of the distances of the round before.
REACH_SPACINGS, REACH_SCALES = 2.0, 5.0
# At first, in times the first number.
FIRST_REACH_FACTOR = 2.0
# Normals farther apart than this are of different faces; the second is for a look at what hangs on the first.
MIN_NORMAL_COS, STRICT_NORMAL_COS = float(np.cos(np.deg2rad(45.0))), float(np.cos(np.deg2rad(15.0)))
# The first rounds, so many at most, are with so many times fewer points,
MAX_COARSE_ROUNDS, COARSE_POINTS_DIVISOR = 10, 4
# until the scans move by less than this in a round, in spacings.
COARSE_STILL_SPACINGS = 0.1
# Least scale of the distances in the first round, in spacings, and its factor a round. Small faces, which alone hold
# some motions, are many scales of the large ones off at first, and would count as outliers.
FIRST_SCALE_SPACINGS, SCALE_FACTOR = 0.4, 0.9
# Where it ends: in noises of the least noisy scan, and in spacings.
LAST_SCALE_NOISES, LAST_SCALE_SPACINGS = 0.5, 2e-3


@dataclasses.dataclass(frozen=True)
class Joint:
    """All poses and the correspondences that they rest on."""

    T_world_body: FloatArray  # (n, 4, 4): Of the centred frames
    planes: tuple[WeighedMatches, ...]  # One a direction of a pair
    rounds: int
    converged: bool


def refine_jointly(
    bodies: Sequence[Body],
    T_world_body: FloatArray,
    pairs: Sequence[tuple[int, int]],
    free: IntArray,
    points: int,
    *,
    strict: bool = False,
    most: int = 0,
) -> Joint:
    """Poses of the bodies with the least cost over all pairs (target, source), by Gauss-Newton steps.

    The part, a body without points, is the target only. Strict asks for half of the reach and for normals that agree
    closely: what that changes in poses that are refined already hangs on doubtful correspondences. Most is the number
    of rounds, where it is not the usual one.

    Shapes: T_world_body (n, 4, 4).
    """
    ways = [way for i, j in pairs for way in ((i, j), (j, i)) if bodies[way[1]].scan is not None]
    budget = int(np.clip(MAX_POINTS // max(len(ways), 1), MIN_POINTS_PER_DIRECTION, points))
    few = max(budget // COARSE_POINTS_DIVISOR, MIN_POINTS_PER_DIRECTION)
    T = T_world_body.copy()
    found: dict[tuple[int, int], WeighedMatches] = {}
    rounds, moved, coarse, soft = 0, np.inf, few < budget and not strict, 0.0 if strict else FIRST_SCALE_SPACINGS
    hard = _last_scale(bodies)
    matchings = _matchings(bodies, ways, few if coarse else budget)
    faster = JointAnderson(free, np.array([0.5 * body.surface.diagonal for body in bodies]))
    motions: list[float] = []
    most = most or (MAX_STRICT_ROUNDS if strict else MAX_ROUNDS)
    while rounds < most and (coarse or soft > 0.0 or not _has_ended(motions)):
        ask_clock()
        rounds, new = rounds + 1, rounds == 0
        if coarse and (moved < COARSE_STILL_SPACINGS or rounds >= MAX_COARSE_ROUNDS):
            # Pairs that met nowhere at first may do so from better poses.
            coarse, new, matchings = False, True, _matchings(bodies, ways, budget)
            faster.restart()
            motions.clear()
        found = _correspond(matchings, T, found, new=new, strict=strict, soft=soft)
        if not found:
            # Sparse clouds may meet nowhere with half of the reach.
            return Joint(T, (), rounds, converged=False)
        if soft > 0.0:
            soft = soft * SCALE_FACTOR if soft * SCALE_FACTOR > hard else 0.0
            motions.clear()
        before = T
        for _ in range(STEPS_PER_ROUND):
            T, motion = _stepped(T, list(found.values()), free)
            if motion < STILL_SPACINGS * 0.1:
                break
        moved = _motion(bodies, before, T)
        motions.append(moved)
        T = faster.propose(before, T)
    return Joint(T, tuple(found.values()), rounds, moved < CONVERGED_SPACINGS)


def _has_ended(motions: Sequence[float]) -> bool:
    """Whether a round moved nothing, or several moved little and no less than those before."""
    if not motions or motions[-1] < STILL_SPACINGS:
        return bool(motions)
    recent, earlier = motions[-STALLED_ROUNDS:], motions[:-STALLED_ROUNDS]
    return motions[-1] < CONVERGED_SPACINGS and bool(earlier) and min(recent) >= min(earlier)


def _matchings(bodies: Sequence[Body], ways: Iterable[tuple[int, int]], count: int) -> dict[tuple[int, int], Matching]:
    rows = {j: bodies[j].rows(count) for j in {j for _, j in ways}}
    return {(i, j): Matching(bodies[j], bodies[i], rows[j]) for i, j in ways}


def _correspond(
    matchings: Mapping[tuple[int, int], Matching],
    T: FloatArray,
    before: Mapping[tuple[int, int], WeighedMatches],
    *,
    new: bool,
    strict: bool,
    soft: float,
) -> dict[tuple[int, int], WeighedMatches]:
    found = {}
    for (i, j), matching in matchings.items():
        known = before.get((i, j))
        if known is None and not new:
            continue
        reach, facing = _reach(matching, known), MIN_NORMAL_COS
        if strict:
            reach, facing = 0.5 * reach, STRICT_NORMAL_COS
        matches = matching.at(pose.inverse(T[i]) @ T[j], reach, facing)
        planes = planes_of((i, j), matching.source, matching.target, matches, reach, known, soft)
        if planes is not None:
            found[i, j] = planes
    return found


def _last_scale(bodies: Sequence[Body]) -> float:
    """Least scale of the distances, in spacings, that is next to none."""
    ratios = [body.scan.noise / body.scan.spacing for body in bodies if body.scan is not None]
    return max(LAST_SCALE_NOISES * min(ratios), LAST_SCALE_SPACINGS)


def _reach(matching: Matching, known: WeighedMatches | None) -> float:
    ends = matching.source.scan, matching.target.scan
    spacing = max(scan.spacing for scan in ends if scan is not None)
    widest = FIRST_REACH_FACTOR * REACH_SPACINGS * spacing
    return widest if known is None else float(np.clip(REACH_SCALES * known.sigma, REACH_SPACINGS * spacing, widest))


def linearised(T: FloatArray, planes: Sequence[WeighedMatches]) -> tuple[PoseGraph, FloatArray, FloatArray]:
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


def _stepped(T: FloatArray, planes: Sequence[WeighedMatches], free: IntArray) -> tuple[FloatArray, float]:
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


def _motion(bodies: Sequence[Body], before: FloatArray, after: FloatArray) -> float:
    """Largest motion of the corners of a scan, in spacings."""
    change = after - before
    turned = np.linalg.norm(change[:, :3, :3], 2, axis=(1, 2))
    half = 0.5 * np.array([body.surface.diagonal for body in bodies])
    spacings = np.array([np.inf if body.scan is None else body.scan.spacing for body in bodies])
    return float(((np.linalg.norm(change[:, :3, 3], axis=1) + half * turned) / spacings).max())
