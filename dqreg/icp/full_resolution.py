"""The finer levels, once the pose is near: full resolution for few closest-point queries.

The point-to-plane cost is additive: points whose closest points lie inside one and the same face enter it through their
number, mean and scatter. So one query a run of neighbouring points finds the face, arithmetic decides which points of
the run lie on it, and only the others are queried individually. On five CAD parts 60 to 85 % of 300,000 points are
settled by 10,000 queries, and the pose is as exact as with one query a point. Where all others are queried, points of
one part of the scan are taken together, so that what each part says of a face still has a weight of its own: without
that the error is 3 % larger. With few others it was 12 % less on one of five parts, 3 % more on another, 5 % slower.

On clouds, and for other estimators, each level draws its points, the last one those with the largest information gain.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dqreg._arrays import BoolArray, FloatArray, IntArray
from dqreg._records import replaced
from dqreg.geometry.cloud_surface import CloudSurface
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.geometry.scan import Scan
from dqreg.geometry.scan_measures import CLOUD_PARTS
from dqreg.geometry.surface import Closest
from dqreg.geometry.vector_rows import row_dots
from dqreg.icp.constrained_steps import motions_of_shape, planes_along
from dqreg.icp.correspondences import Correspondences, find_correspondences
from dqreg.icp.informative_sampling import information_gain, sample_by_gain, sample_runs_by_gain
from dqreg.icp.level import SAMPLING_LIMITED_POINTS, AnnealingSchedule, IcpSettings, Level
from dqreg.icp.loop import Alignment, Observer, Run
from dqreg.icp.noise_by_face import motions_of_creases, points_to_weighted_faces, weights_by_face
from dqreg.kernels.threads import TimeUpError, until
from dqreg.rigid import pose

# A point belongs to its run's face if it is so many widths inside each side of it and off it by less than so many.
INSIDE_SCALES, OFF_SCALES = 3.0, 4.0
# Where the points of a run scatter about the face by more widths than this, and about their mean by more than that,
# there is more than one face: a sheet, say. Noise that the run shares lifts its mean alone.
ONE_FACE_SCALES, ONE_HEIGHT_SCALES = 1.5, 1.25
# Runs by which it is seen whether the order of a scan tells its parts, and their share of all parts that says no.
MIXED_RUNS, MIXED_SHARE = 200, 0.75
# Points looked at in one go: what is in between stays in the cache.
CHUNK_POINTS = 65_536


def run_centres(total: int, runs: int) -> tuple[IntArray, int]:
    """The scan cut into about so many runs of neighbours, all of one length; what is left over is in none.

    Shapes: rows (m,).
    """
    length = -(-total // runs)
    return length // 2 + length * np.arange(total // length), length


def gather(
    scan: Scan,
    surface: MeshSurface,
    pairs: Correspondences,
    weights: FloatArray,
    T: FloatArray,
    width: float,
    count: int,
) -> Correspondences:
    """Pairs for all points that lie on the face of their run, one a run, and for a choice of the others.

    Shapes: weights (m,).
    """
    runs = len(pairs.scan)
    length = len(scan) // runs
    of_scan = _parts_of_runs(scan, runs, length) if count >= len(scan) else None
    on, counts, means, within = _on_faces(scan.points, of_scan, length, surface, pairs, T, width)
    runs_of, parts = np.nonzero(counts)
    counts, lengths = counts[runs_of, parts], length - counts.sum(axis=1)
    gone = np.zeros(len(scan), dtype=bool)
    gone[: on.size] = on.ravel()
    lengths[-1] += len(scan) - on.size
    asked = sample_runs_by_gain(information_gain(pairs, weights), lengths, count, gone)
    order = np.argsort(np.r_[runs_of * length + length // 2, asked], kind="stable")
    rows, rows_alone = np.flatnonzero(order < len(runs_of)), np.flatnonzero(order >= len(runs_of))

    def both(of_runs: NDArray[Any] | int, of_alone: NDArray[Any]) -> NDArray[Any]:
        # Both stand in their order among themselves: to be written to their places takes half of a sort's time.
        merged = np.zeros((len(order), *of_alone.shape[1:]), dtype=of_alone.dtype)
        merged[rows], merged[rows_alone] = of_runs, of_alone
        return merged

    alone, means = find_correspondences(scan.taken(asked), surface, T), means[runs_of, parts]
    moved = pose.apply(T, means)
    normals = np.take(pairs.closest.normals, runs_of, axis=0)
    heights = row_dots(moved - np.take(pairs.closest.points, runs_of, axis=0), normals)
    found, others = alone.closest, alone.scan
    closest = Closest(
        both(moved - heights[:, None] * normals, found.points),
        both(normals, found.normals),
        both(np.abs(heights), found.distances),
        both(pairs.closest.elements[runs_of], found.elements),
    )
    none = np.zeros((len(runs_of), 3))
    together = dataclasses.replace(
        scan,
        points=both(means, others.points),
        normals=both(none, others.normals),
        levers=both(none[:, 0], others.levers),
        residuals=both(none[:, 0] * np.nan, others.residuals),
        fitted=np.zeros(0, dtype=np.int64),
        counts=both(counts, np.ones(len(asked))),
        within=both(within[runs_of, parts], np.zeros(len(asked))),
        parts=None if others.parts is None else both(CLOUD_PARTS if of_scan is None else parts, others.parts),
    )
    return Correspondences(together, T, closest, pairs.same_sign, surface)


def _parts_of_runs(scan: Scan, runs: int, length: int) -> NDArray[np.uint8] | None:
    """Part of the scan that each point stands in, (n,); None where runs are of most parts, as in a shuffled scan."""
    if scan.parts is None:
        return None
    some = scan.parts[: runs * length].reshape(runs, length)[:: max(runs // MIXED_RUNS, 1)]
    seen, most = np.bitwise_or.reduce(np.left_shift(np.uint8(1), some), axis=1), int(some.max()) + 1
    held = np.unpackbits(seen).sum() / len(seen)
    return None if most > 1 and held > MIXED_SHARE * min(length, most) else scan.parts


def _on_faces(
    points: FloatArray,
    parts: NDArray[np.uint8] | None,
    length: int,
    surface: MeshSurface,
    pairs: Correspondences,
    T: FloatArray,
    width: float,
) -> tuple[BoolArray, IntArray, FloatArray, FloatArray]:
    """Which points of each run lie on its face, (m, k), and what those of each part of the scan come to.

    How many they are, (m, p), their mean, (m, p, 3), and their scatter along it, (m, p).
    """
    from dqreg.kernels.steps.points_on_faces import points_on_faces
    from dqreg.kernels.threads import as_plain, over_chunks

    runs = len(pairs.scan)
    shape = runs, 1 if parts is None else CLOUD_PARTS
    on, counts = np.zeros((runs, length), dtype=bool), np.zeros(shape, dtype=np.int64)
    means, within = np.zeros((*shape, 3)), np.zeros(shape)
    faces = as_plain(surface.mesh.corners), pairs.closest.elements, as_plain(pairs.closest.normals)
    limits = INSIDE_SCALES * width, OFF_SCALES * width, ONE_FACE_SCALES * width, ONE_HEIGHT_SCALES * width
    step, parts = max(CHUNK_POINTS // length, 1), np.zeros(len(points), dtype=np.uint8) if parts is None else parts
    given = as_plain(points), length, *faces, as_plain(T), *limits, parts
    over_chunks(points_on_faces, runs, *given, on, counts, means, within, chunk=step)
    return on, counts, means, within


FINE_SCHEDULE = AnnealingSchedule("fine", stages=30, iterations=None, rounds=30)
# Points of the level between the coarse and the last one.
MIDDLE_POINTS = 10_000
# On rims; where the steps go on for longer, they go to and fro.
RIM_SCHEDULE = replaced(FINE_SCHEDULE, iterations=40)
# Where points are taken together, of the points that the plan has for its last level: one run of neighbours for so
# many, and one point that is asked about by itself for so many.
POINTS_PER_RUN, POINTS_PER_SINGLE = 6, 4
# Runs where the plan takes all points, and each that does not lie on the face of its run is asked about by itself.
RUNS_OF_ALL = 20_000
# The shortest run.
MIN_RUN_POINTS = 4
# Width of the kernel beyond which two clouds differ in shape, in spacings or noises of the scan, whichever is more:
# right poses of measured pairs came to 1.5 and less, wrong ones to 3.5 and more. And the share of inliers from which on
# it is the scene that is rough, as before a LiDAR: 0.84 there, 0.2 to 0.5 of views that hardly overlap.
WIDE_SCALE_SPACINGS, ROUGH_SCENE_FRACTION = 2.5, 2 / 3


def finish(level: Level, scan: Scan, counts: list[int], run: Alignment, observe: Observer | None) -> Alignment:
    """Resume on the finer levels; where the time is up within one, what was there before it stays."""
    surface, finest, counts = level.surface, level.plan.finest, _level_counts(level, scan, counts, run)
    planes = level.plan.fine is not None and run.near
    asked = (RUNS_OF_ALL, len(scan)) if finest is None else (finest // POINTS_PER_RUN, finest // POINTS_PER_SINGLE)
    long = len(scan) >= MIN_RUN_POINTS * asked[0]
    try:
        with until(level.plan.deadline):
            if counts and planes and long and isinstance(surface, MeshSurface):
                return _runs_and_singles(level, scan, surface, asked, run, observe)
            for count in counts:
                if run.ended_early:
                    break
                level = _level_with_sample(level, scan, count, last=count == counts[-1], so_far=run)
                run = _continued(level, run, observe)
    except TimeUpError:
        return replaced(run, status="time limit")
    return run


def _level_counts(level: Level, scan: Scan, counts: list[int], run: Alignment) -> list[int]:
    """Points of the levels; between clouds that differ no more than one a square of the kernel's width.

    There the distances are those of two shapes, and points within a width of each other have theirs in common; and of
    those far from the target each query is dear.
    """
    width = run.mixture.scale / max(scan.noise, scan.spacing)
    if (
        not isinstance(level.surface, CloudSurface)
        or width <= WIDE_SCALE_SPACINGS
        or run.weights.mean() >= ROUGH_SCENE_FRACTION
    ):
        return counts
    most = max(int(len(scan) / width**2), SAMPLING_LIMITED_POINTS)
    return [*(count for count in counts if count < most), min(most, counts[-1])] if counts else counts


def _runs_and_singles(
    level: Level, scan: Scan, surface: MeshSurface, asked: tuple[int, int], run: Alignment, observe: Observer | None
) -> Alignment:
    """All points: those on the face of their run of neighbours together, and a choice of the others individually."""
    if run.ended_early:
        return run
    runs, singles = asked
    level = _level_on(level, run, scan.taken(run_centres(len(scan), runs)[0]))
    run = _continued(level, run, observe)
    if run.ended_early:
        return run
    pairs = gather(scan, surface, run.pairs, run.weights, run.T_target_source, run.mixture.scale, singles)
    level = replaced(_level_on(level, run, pairs.scan), last=True)
    return _joined(run, level.once(run.mixture, FINE_SCHEDULE, observe, run.next_number, pairs))


def _continued(level: Level, run: Alignment, observe: Observer | None) -> Alignment:
    return _joined(run, level.descend(run.mixture, run.T_target_source, FINE_SCHEDULE, observe, run.next_number))


def _joined(run: Alignment, finer: Alignment) -> Alignment:
    return replaced(finer.after(run), earlier=(*run.earlier, run.pairs))


def _level_on(level: Level, run: Run, scan: Scan) -> Level:
    contraction = level.contraction if run.contraction is None else run.contraction
    return replaced(level, scan=scan, contraction=contraction)


def _level_with_sample(level: Level, scan: Scan, count: int, *, last: bool, so_far: Alignment) -> Level:
    if not so_far.near:
        # The last step was another estimator's.
        return replaced(level, scan=scan.thinned(count), last=last)
    if level.plan.fine is not None and last and count < len(scan):
        places = scan.even_rows(len(level.scan))
        rows = sample_by_gain(information_gain(so_far.pairs, so_far.weights), places, len(scan), count)
        return replaced(_level_on(level, so_far, scan.taken(rows)), last=last)
    return replaced(_level_on(level, so_far, scan.thinned(count)), last=last)


def with_last_step(level: Level, plan: IcpSettings, run: Alignment, observe: Observer | None) -> Alignment:
    """The run after one step of the last estimator, from its last correspondences: planes on a mesh have settled.

    Along what the shape of the part holds alone, where that leaves a motion free; the loop goes on along that before.
    """
    if plan.last is None or not _is_settled_on_part(plan, run):
        return run
    axes = motions_of_shape(run.pairs, run.weights) if plan.last is points_to_weighted_faces else None
    if axes is None:
        return replaced(run, T_target_source=plan.last(run.pairs, run.weights, run.mixture.scale).T_target_source)
    along, near = planes_along(axes), replaced(level.plan, estimator=planes_along(axes))
    level = replaced(level, plan=near, scan=run.pairs.scan, last=True, contraction=1.0)
    held = level.once(run.mixture, FINE_SCHEDULE, observe, run.next_number, run.pairs)
    if held.found:
        run = replaced(held.after(run), earlier=run.earlier)
    if motions_of_creases(run.pairs, run.weights, run.mixture.scale) is not None:
        # What these and the other points hold leaves out what nothing does.
        along, weights = plan.last, run.weights
    else:
        weights = weights_by_face(run.pairs, run.weights, run.mixture.scale)
    return replaced(run, T_target_source=along(run.pairs, weights, run.mixture.scale).T_target_source)


def settled_on_rims(level: Level, run: Alignment, observe: Observer | None) -> Alignment:
    """The run gone on with: what points near edges alone hold is few of them, and each step leaves half of the way."""
    if not _is_settled_on_part(level.plan, run) or len(run.pairs.scan) <= SAMPLING_LIMITED_POINTS:
        return run
    if motions_of_creases(run.pairs, run.weights, run.mixture.scale) is None:
        return run
    level = replaced(level, scan=run.pairs.scan, last=True, patient=True, contraction=1.0)
    finer = level.once(run.mixture, RIM_SCHEDULE, observe, run.next_number, run.pairs)
    return replaced(finer.after(run), earlier=run.earlier, status=run.status) if finer.found else run


def _is_settled_on_part(plan: IcpSettings, run: Alignment) -> bool:
    is_settled = run.found and not run.ended_early and run.near
    return is_settled and plan.last is not None and isinstance(run.pairs.surface, MeshSurface)
