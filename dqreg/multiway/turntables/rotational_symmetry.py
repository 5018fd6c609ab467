"""Whether views can be turned: a part that looks the same about an axis, from the merged model and from rivals."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.multiway.pose_graph.edges import PART, Edge, is_refused
from dqreg.multiway.scans.scans import View, typical_size
from dqreg.multiway.turntables.round_part import RoundPart
from dqreg.multiway.turntables.symmetric_part import symmetric_axis
from dqreg.rigid import DualQuaternion, pose
from dqreg.solvers.robust import GAUSSIAN_MEDIAN
from dqreg.trust.code_sets import HARDLY_HELD

# Points of a view that are looked at, and views.
POINTS_PER_VIEW, MAX_VIEWS = 1_500, 6
# Rounds of the fit of the axis.
AXIS_ROUNDS = 15
# A normal's line misses the axis of a round face by less than this, in sizes, at a lever of one; and the share of the
# points that must be on round faces for the part to be nearly round.
AXIS_MISS_SIZES, MIN_ROUND_SHARE = 0.02, 0.8
# Turns that are tried, and the share of what lies on the others unturned that must do so at each of them.
TRIED_TURNS_RAD, MIN_KEPT_SHARE = np.deg2rad([10.0, 17.0, 30.0, 41.0]), 0.9
# A point lies on another view within so many spacings, at this cosine of the normals,
NEAR_SPACINGS, MIN_NORMAL_COS = 3.0, 0.9
# and within so many scales of noise along the normal, or spacings if these are more.
NEAR_NOISES, MIN_NEAR_SPACINGS = 4.0, 0.1
NEAR_NEIGHBOURS = 4
# Rotations of rivals that are one: radians, sizes.
SAME_TURN_RAD, SAME_TURN_SIZES = np.deg2rad(8.0), 0.05
# Those that are none.
MIN_TURN_RAD = np.deg2rad(5.0)
# Pairs, at least; and share of the used ones that must name one rotation.
MIN_PAIRS, MIN_NAMING_SHARE = 2, 0.25
# Turns that contradicting pairs name, and that are tried on the model.
MAX_TRIED_TURNS = 6
# Views that show a part from so many sides that its model can be asked for symmetries.
MIN_VIEWS_OF_MODEL = 4


@dataclasses.dataclass(frozen=True)
class UnobservableRotation:
    """A rotation in the world frame that no view, or few of them, can tell from none."""

    axis: FloatArray  # (3,)
    point: FloatArray  # (3,): On the axis
    angle_rad: float | None  # None where any angle will do
    telling: float  # Share of the points of a view that tell one angle from another, about; NaN if not measured
    frame: int | None = None  # Scan in whose frame it is, where none is placed; None for the world frame
    agreed: str = ""  # Where the angles of a round part come from: "starts", "step" or "pairs"
    step_rad: float = 0.0  # Of a turntable, where it was assumed


def turnings(
    views: Sequence[View],
    T_world_scan: FloatArray,
    edges: Sequence[Edge],
    known: RoundPart | None = None,
    *,
    started: bool = False,
) -> tuple[UnobservableRotation, ...]:
    """Rotations by which views can be turned: of a round part, and those that several pairs name as rivals.

    A symmetry of the model alone is one too, unless all scans were started: then the starts tell which.
    """
    placed = [k for k, view in enumerate(views) if view.usable and np.isfinite(T_world_scan[k]).all()]
    if len(placed) < 2:
        return tuple(_from_pairs(edges))
    model = _PartModel.of(views, T_world_scan, placed)
    if known is not None:
        axis, point = known.axis(T_world_scan)
        telling = 1.0 - model.kept(axis, point, TRIED_TURNS_RAD)
        return (UnobservableRotation(axis, point, None, telling, agreed=known.agreed, step_rad=known.step_rad),)
    found = _round(model)
    if found is not None:
        return (found,)
    turns = list(_from_rivals(T_world_scan, edges, typical_size([views[k] for k in placed])))
    turns = turns or _from_contradictions(model, T_world_scan, edges)
    return tuple(turns or ([] if started or len(placed) < MIN_VIEWS_OF_MODEL else _from_model(model)))


def _from_pairs(edges: Sequence[Edge]) -> Iterator[UnobservableRotation]:
    """The rotation that is the least held motion of most pairs, in the frame of the first one's target."""
    # A pose that does not fit is held by other things than the part's shape.
    found = [
        edge
        for edge in edges
        if edge.found and edge.target != PART and edge.registration.observability and not is_refused(edge)
    ]
    loose = [
        edge
        for edge in found
        if edge.registration.observability[0].kind == "rotation" and HARDLY_HELD & set(edge.registration.verdict.codes)
    ]
    if len(loose) >= MIN_PAIRS and len(loose) > 0.5 * len(found):
        motion = loose[0].registration.observability[0]
        yield UnobservableRotation(np.array(motion.axis), np.array(motion.point), None, np.nan, loose[0].target)


@dataclasses.dataclass(frozen=True)
class _PartModel:
    """Points and normals of the placed scans in the world frame, some of each."""

    clouds: tuple[tuple[FloatArray, FloatArray], ...]
    spacing: float
    thick: float  # Distance along the normal within which points are of one surface

    @staticmethod
    def of(views: Sequence[View], T_world_scan: FloatArray, placed: Sequence[int]) -> _PartModel:
        spacing = float(np.median([views[k].scan.spacing * np.sqrt(_step(views[k])) for k in placed]))
        noise = float(np.median([views[k].scan.noise for k in placed]))
        clouds = tuple(_in_world(views[k], T_world_scan[k]) for k in placed)
        return _PartModel(clouds, spacing, max(NEAR_NOISES * noise, MIN_NEAR_SPACINGS * spacing))

    def kept(self, axis: FloatArray, point: FloatArray, angles: FloatArray) -> float:
        """Share of a view, of what lies on the others, that does so too when it is turned: the median of some views."""
        count, found = len(self.clouds), []
        for k in range(0, count, max(1, count // MAX_VIEWS)):
            rest = [np.concatenate([self.clouds[j][row] for j in range(count) if j != k]) for row in (0, 1)]
            turned = _kept_when_turned(self.clouds[k], rest, (axis, point), self.spacing, self.thick, angles)
            found.append(turned)
        return float(np.median(found))


def _round(model: _PartModel) -> UnobservableRotation | None:
    """The axis of a part that is nearly a solid of revolution, if views can be turned about it."""
    points, normals = (np.concatenate([cloud[row] for cloud in model.clouds]) for row in (0, 1))
    axis, point, share = axis_of_revolution(points, normals, float(np.linalg.norm(np.ptp(points, axis=0))))
    if share < MIN_ROUND_SHARE:
        return None
    kept = model.kept(axis, point, TRIED_TURNS_RAD)
    return UnobservableRotation(axis, point, None, 1.0 - kept) if kept >= MIN_KEPT_SHARE else None


def _from_contradictions(
    model: _PartModel, T_world_scan: FloatArray, edges: Sequence[Edge]
) -> list[UnobservableRotation]:
    """The least turn that an accepted pair names against all others, and by which the model comes to lie on itself."""
    against = []
    for edge in edges:
        if edge.code != "contradicts" or edge.level != "accepted" or edge.target == PART:
            continue
        W = T_world_scan[edge.target]
        D = W @ edge.registration.T_target_source @ pose.inverse(T_world_scan[edge.source])
        twist = pose.log(D) if np.isfinite(D).all() else np.zeros(6)
        if (angle := float(np.linalg.norm(twist[:3]))) > MIN_TURN_RAD:
            against.append((angle, twist[:3] / angle, D))
    for angle, axis, D in sorted(against, key=lambda each: each[0])[:MAX_TRIED_TURNS]:
        point = DualQuaternion.from_matrix(D).as_screw().point
        kept = model.kept(axis, point, np.array([angle]))
        if kept >= MIN_KEPT_SHARE:
            return [UnobservableRotation(axis, point, angle, 1.0 - kept)]
    return []


def _from_model(model: _PartModel) -> list[UnobservableRotation]:
    """The symmetry of the model, which pairs cannot name: each found the pose with the largest overlap."""
    points, normals = (np.concatenate([cloud[row] for cloud in model.clouds]) for row in (0, 1))
    found = symmetric_axis(points, normals, model.spacing, model.thick)
    return [] if found is None else [UnobservableRotation(found[0], found[1], 2.0 * np.pi / found[2], 0.0)]


def axis_of_revolution(points: FloatArray, normals: FloatArray, size: float) -> tuple[FloatArray, FloatArray, float]:
    """Axis and point about which the points can slip best, and the share of them that can (Gelfand and Guibas 2004).

    Shapes: points and normals (n, 3).
    """
    weights = np.ones(len(points))
    axis, point, missed = np.zeros(3), np.zeros(3), np.zeros(len(points))
    for _ in range(AXIS_ROUNDS):
        centre = np.average(points, axis=0, weights=weights)
        rows = np.hstack([np.cross((points - centre) / size, normals), normals])
        squares = (rows * weights[:, None]).T @ rows / weights.sum()
        shift = -np.linalg.solve(squares[3:, 3:] + 1e-9 * np.eye(3), squares[3:, :3])
        axis = np.linalg.eigh(squares[:3, :3] + squares[:3, 3:] @ shift)[1][:, 0]
        missed = np.abs(rows @ np.r_[axis, shift @ axis])
        point = centre + size * np.cross(axis, shift @ axis)
        scale = max(GAUSSIAN_MEDIAN * float(np.median(missed)), 0.25 * AXIS_MISS_SIZES)
        weights = 1.0 / (1.0 + (missed / (2.0 * scale)) ** 2) ** 2
    return axis, point, float(np.mean(missed < AXIS_MISS_SIZES))


def _kept_when_turned(
    view: tuple[FloatArray, FloatArray],
    rest: Sequence[FloatArray],
    about: tuple[FloatArray, FloatArray],
    spacing: float,
    thick: float,
    angles: FloatArray,
) -> float:
    """Least share of a view, of what lies on the others, that does so too when the view is turned about an axis."""
    tree = NeighbourTree(rest[0])

    def share(angle: float) -> float:
        D = pose.about(pose.exp(np.r_[angle * about[0], np.zeros(3)]), about[1])
        points, normals = pose.apply(D, view[0]), view[1] @ D[:3, :3].T
        rows, distances = tree.nearest(points, NEAR_NEIGHBOURS)
        along = np.abs(np.einsum("ikj,ikj->ik", points[:, None] - rest[0][rows], rest[1][rows]))
        cosines = np.abs(np.einsum("ij,ikj->ik", normals, rest[1][rows]))
        there = (distances < NEAR_SPACINGS * spacing) & (along < thick) & (cosines > MIN_NORMAL_COS)
        return float(np.mean(there.any(axis=1)))

    # One way round or the other may leave what the rest shows.
    turned = [max(share(angle), share(-angle)) for angle in angles.tolist()]
    return min(turned) / max(share(0.0), 1.0 / len(view[0]))


def _in_world(view: View, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    rows = np.flatnonzero(view.scan.directed)[:: _step(view)]
    return pose.apply(T, view.scan.points[rows] + view.origin), view.scan.normals[rows] @ T[:3, :3].T


def _step(view: View) -> int:
    return max(1, len(view.scan.points) // POINTS_PER_VIEW)


def _from_rivals(T_world_scan: FloatArray, edges: Sequence[Edge], size: float) -> Iterator[UnobservableRotation]:
    """Rotations that several used pairs name as other likely poses, in the world frame."""
    named: list[tuple[int, FloatArray]] = []
    fewest = max(MIN_PAIRS, MIN_NAMING_SHARE * sum(edge.used for edge in edges))
    for row, edge in enumerate(edges):
        if not edge.used or edge.target == PART:
            continue
        W = T_world_scan[edge.target]
        for rival in edge.registration.alternatives:
            D = W @ rival.T_target_source @ pose.inverse(edge.registration.T_target_source) @ pose.inverse(W)
            if float(pose.angle_between(D, np.eye(4))) > MIN_TURN_RAD:
                named += [(row, D), (row, pose.inverse(D))]
    middle = np.nanmean(T_world_scan[:, :3, 3], axis=0) if len(named) else np.zeros(3)
    while named:
        first = named[0][1]
        near = [
            (row, D)
            for row, D in named
            if float(pose.angle_between(D, first)) <= SAME_TURN_RAD
            and np.linalg.norm(pose.apply(D, middle[None]) - pose.apply(first, middle[None])) <= SAME_TURN_SIZES * size
        ]
        if len({row for row, _ in near}) >= fewest:
            twist = pose.log(first)
            angle = float(np.linalg.norm(twist[:3]))
            axis = twist[:3] / angle
            yield UnobservableRotation(axis, DualQuaternion.from_matrix(first).as_screw().point, angle, np.nan)
            # Its inverse says the same.
            inverse = pose.inverse(first)
            near += [(row, D) for row, D in named if float(pose.angle_between(D, inverse)) <= SAME_TURN_RAD]
        gone = {id(D) for _, D in near}
        named = [(row, D) for row, D in named if id(D) not in gone]
