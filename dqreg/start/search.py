"""The search for a start: proposals from pairs, axes and matches, screened, refined in batches, ranked by a judge."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from functools import cached_property

import numpy as np

from dqreg.arrays import FloatArray, IntArray
from dqreg.geometry import CloudSurface, Mesh, PointCloud, Scan, Surface, prepare_scan
from dqreg.geometry.neighbours import NeighbourTree
from dqreg.geometry.normals import sample_rows
from dqreg.icp import COARSE, Plan, width_floor
from dqreg.rigid import pose
from dqreg.start.axes import propose_turns
from dqreg.start.clock import Clock, Observer, Poses
from dqreg.start.features import Features, scan_features
from dqreg.start.judging import Judgement, weigh_up
from dqreg.start.matches import VOXEL, Described, match_hypotheses
from dqreg.start.occupancy import Occupancy
from dqreg.start.pairs import PairTable, hypotheses
from dqreg.start.refining import Sample, refine
from dqreg.start.screening import distinct

# Screening: few points for all poses, more for the best; reach in sizes; poses kept.
FEW, MORE, REACH, SHORTLIST = 64, 400, 0.03, 1_500
# A point at a rim counts half a point on a face.
RIM_GAIN = 0.5
# Distinct poses kept after each stage, and how far apart they stand: radians, sizes.
ROUGH_KEPT, FIT_KEPT, FINE_KEPT, LAST_KEPT = 160, 40, 12, 8
ROUGH_APART, FIT_APART, FINE_APART, LAST_APART = (0.15, 0.03), (0.06, 0.015), (0.04, 0.01), (0.03, 0.005)
# Widths of the refinement, in sizes: first, last, steps. Down to the second the grid knows enough.
ROUGH_WIDTHS, GRID_WIDTHS, FIT_WIDTHS = (0.03, 0.012, 5), (0.012, 0.008, 2), (0.006, 0.004, 2)
# Best poses that are also tried in all turns that leave most of the part in place; such poses in all.
TURNED, TURNS = 4, 64
# Points that judge; and how far behind the best, in mean log-likelihood, a pose is given up: after the refinement, and
# after the fine one. Of the first as many are kept in any case.
JUDGES, MORE_JUDGES, LAST_JUDGES = 600, 4_000, 20_000
HOPELESS, BEATEN, KEPT_ANYWAY = 0.7, 0.25, 3
# The same for two clouds: judges after the rough refinement, widths there, after the next and after the fine one, and
# at the end; poses kept that matches propose.
CLOUD_JUDGES, CLOUD_WIDTHS, LAST_WIDTH, MATCHED_KEPT = 200, (8e-3, 4e-3, 2e-3), 1e-3, 80
# A scan so many times larger than the target is a scene with the part in it.
SCENE = 1.3
# Places of the target that are looked for on such a scan.
TARGET_FEW, TARGET_MORE = 64, 400
# A mean log-likelihood this close to the best explains the scan as well; so does one within so many standard errors,
# but never one farther behind than the last number.
AS_GOOD, ERRORS, WORSE = 0.02, 2.0, 0.05


@dataclasses.dataclass(frozen=True)
class Candidate:
    """A start pose and how badly it explains the scan.

    Attributes
    ----------
    T_target_source : ndarray, (4, 4)
        The pose after short refinements.
    surprise : float
        Mean negative log-likelihood of the distances; the lower the better.
    rms : float
        Truncated root mean square distance, a length.
    stage : str
        The last stage that was finished: "judged", or what there was when the time was up.
    symmetry : str
        For a pose that is the first one followed by a symmetry of the part itself: that symmetry in words; else "".
    """

    T_target_source: FloatArray
    surprise: float
    rms: float
    stage: str = "judged"
    symmetry: str = ""


def search(
    scan: Scan,
    surface: Surface,
    target: PointCloud | Mesh,
    plan: Plan,
    table: PairTable,
    rng: np.random.Generator,
    *,
    time_limit: float | None = None,
    observe: Observer | None = None,
    now: Callable[[], float] | None = None,
) -> tuple[Candidate, ...]:
    """Start poses that explain the scan about as well as the best one, the best first.

    Parameters
    ----------
    scan : Scan
        Source.
    surface : Surface
        Target.
    target : PointCloud or Mesh
        The same target, for its principal axes.
    plan : Plan
        Parts of the loop and its largest distance.
    table : PairTable
        The target's pairs.
    rng : numpy.random.Generator
        Source of randomness; the same state gives the same poses, unless the time is up.
    time_limit : float, optional
        Seconds after which no further stage is begun; the best so far comes back, with the ``stage`` it reached.
    observe : callable, optional
        Called with each `Stage`; returning False ends the search like the time limit does.
    now : callable, optional
        Clock, in seconds; the default is `time.perf_counter`.

    Returns
    -------
    tuple of Candidate
        One or more distinct poses; empty if nothing found correspondences.
    """
    clock = Clock(time_limit, observe, now)
    given = _Task(scan, surface, target, plan, table, rng)
    task, back = _turned_round(given)
    poses, reached = task.proposed(), "proposed"
    for name, stage in task.stages:
        if clock.is_up(reached, poses):
            return given.best_so_far(back(task.first(poses, reached)), reached)
        poses, reached = stage(poses), name
    clock.is_up(reached, poses)
    return given.judged(back(poses))


@dataclasses.dataclass(frozen=True)
class _Task:
    """One search: what is given, and the stages, each from poses to fewer and better ones."""

    scan: Scan
    surface: Surface
    target: PointCloud | Mesh
    plan: Plan
    table: PairTable
    rng: np.random.Generator

    @property
    def stages(self) -> tuple[tuple[str, Callable[[Poses], Poses]], ...]:
        return (
            ("screened", self.screened),
            ("refined roughly", self.refined_roughly),
            ("refined", self.refined),
            ("turned", self.turned),
            ("refined finely", self.refined_finely),
        )

    @cached_property
    def places(self) -> Features:
        return scan_features(self.scan, self.size)

    @cached_property
    def edge_tree(self) -> NeighbourTree | None:
        return NeighbourTree(self.table.edges) if len(self.table.edges) else None

    @cached_property
    def size(self) -> float:
        """Unit of lengths: the target's diagonal, or that of a scan that is smaller than a cloud."""
        if isinstance(self.target, Mesh):
            return self.table.size
        return min(self.table.size, self.scan.diagonal)

    @cached_property
    def occupancy(self) -> Occupancy | None:
        """For the other way round, where much of the scan need not lie on the target."""
        if isinstance(self.target, Mesh) and self.scan.diagonal <= SCENE * self.table.size:
            return None
        return Occupancy(self.scan.points, self.size)

    @property
    def last_width(self) -> float:
        return 0.0 if isinstance(self.target, Mesh) else LAST_WIDTH

    @property
    def limit(self) -> float:
        # Beyond it a point tells nothing more.
        return 0.25 * self.plan.max_distance

    def proposed(self) -> Poses:
        turns = np.array(propose_turns(self.scan, self.target))
        return Poses(*hypotheses(self.places, self.table, self.rng)) + Poses(turns[:, :3, :3], turns[:, :3, 3])

    def matched(self, target: PointCloud) -> Poses:
        """Poses from features that both clouds have."""
        voxel = VOXEL * self.size
        signed = self.scan.normals if self.scan.oriented and self.scan.fitted is None else None
        sides = Described.of(self.scan.points, voxel, signed), Described.of(target.points, voxel, target.normals)
        known = signed is not None and target.normals is not None
        return Poses(*match_hypotheses(*sides, voxel, signs_known=known))

    def screened(self, poses: Poses) -> Poses:
        kept = self._screened(poses, ROUGH_KEPT)
        # Matches that agree are many and alike: they have places of their own.
        return kept if isinstance(self.target, Mesh) else self._screened(self.matched(self.target), MATCHED_KEPT) + kept

    def _screened(self, poses: Poses, most: int) -> Poses:
        for count in (FEW, MORE):
            poses = poses[self._order(poses, count, REACH)[:SHORTLIST]]
        return self._distinct(poses, ROUGH_APART, most)

    def refined_roughly(self, poses: Poses) -> Poses:
        poses = self._refine(poses, Sample.of(self.places, 160, self.rng), ROUGH_WIDTHS, self.table.grid)
        if isinstance(self.target, Mesh):
            return self._distinct(poses[self._order(poses, MORE, 0.02)], FIT_APART, FIT_KEPT)
        return self._distinct(self._ranked(poses, CLOUD_JUDGES, CLOUD_WIDTHS[0], np.inf), FIT_APART, FIT_KEPT)

    def refined(self, poses: Poses) -> Poses:
        poses = self._refine(poses, Sample.of(self.places, 400, self.rng), GRID_WIDTHS, self.table.grid)
        poses = self._refine(poses, Sample.of(self.places, 250, self.rng), FIT_WIDTHS)
        width = 1e-3 if isinstance(self.target, Mesh) else CLOUD_WIDTHS[1]
        return self._distinct(self._ranked(poses, JUDGES, width, HOPELESS), FINE_APART, FINE_KEPT)

    def turned(self, poses: Poses) -> Poses:
        """The best poses in all turns that leave most of the part in place, with all others."""
        near = self.table.symmetry.near if self.table.symmetry else np.zeros((0, 4, 4))
        if not len(near) or not len(poses):
            return poses
        count = max(1, min(TURNED, TURNS // len(near)))
        best = poses[np.arange(min(count, len(poses)))]
        more = Poses(
            np.concatenate([T[:3, :3] @ best.R for T in near]),
            np.concatenate([best.t @ T[:3, :3].T + T[:3, 3] for T in near]),
        )
        more = self._refine(more, Sample.of(self.places, 200, self.rng), (0.01, 0.006, 2), self.table.grid)
        more = self._refine(more, Sample.of(self.places, 200, self.rng), (0.005, 0.004, 2))
        return self._distinct(self._ranked(poses + more, JUDGES, 1e-3, HOPELESS), FINE_APART, FINE_KEPT)

    def refined_finely(self, poses: Poses) -> Poses:
        width = max(2.0 * self.scan.noise / self.size, 1e-3)
        poses = self._refine(poses, self._everywhere(1_000), (max(0.004, width), width, 4), rims=False)
        floor = 5e-4 if isinstance(self.target, Mesh) else CLOUD_WIDTHS[2]
        poses = self._distinct(self._ranked(poses, MORE_JUDGES, floor, BEATEN), LAST_APART, LAST_KEPT)
        # Where one pose is left there is nothing to compare: the loop that follows refines it.
        return poses if len(poses) < 2 else self._refine(poses, self._everywhere(4_000), (width, width, 3), rims=False)

    def judged(self, poses: Poses) -> tuple[Candidate, ...]:
        """All that explain the scan about as well as the best."""
        if not len(poses):
            return ()
        judgement = self._judgement(poses, LAST_JUDGES if len(poses) > 1 else MORE_JUDGES, self.last_width)
        order = np.argsort(-judgement.means, kind="stable")
        behind, error = judgement.behind(int(order[0]))
        allowed = np.clip(ERRORS * error, AS_GOOD, WORSE)
        found: list[Candidate] = []
        for k in order[behind[order] <= allowed[order]]:
            words = ""
            if found and self.table.symmetry:
                words = self.table.symmetry.words_between(found[0].T_target_source, poses.matrix(k))
            found.append(_candidate(poses.matrix(k), judgement, int(k), "judged", words))
        return tuple(found)

    def first(self, poses: Poses, stage: str) -> Poses:
        """The best alone; only the proposed ones are in no order."""
        return (
            poses[self._order(poses, FEW, REACH)[:1]] if stage == "proposed" else poses[np.arange(min(1, len(poses)))]
        )

    def best_so_far(self, poses: Poses, stage: str) -> tuple[Candidate, ...]:
        """The first pose alone: there was no time to compare."""
        if not len(poses):
            return ()
        first = poses[np.arange(1)]
        return (_candidate(first.matrix(0), self._judgement(first, JUDGES, self.last_width), 0, stage, ""),)

    def _order(self, poses: Poses, count: int, reach: float) -> IntArray:
        """Rows by falling gain on the grids."""
        sample, table = Sample.of(self.places, count, self.rng), self.table
        gains = table.grid.scores(poses.R, poses.t, sample.points, reach * self.size)
        if table.edge_grid is not None and len(sample.rims):
            gains = gains + RIM_GAIN * table.edge_grid.scores(poses.R, poses.t, sample.rims, reach * self.size)
        if self.occupancy is not None:
            there = Sample.of(table.features, TARGET_FEW if count == FEW else TARGET_MORE, self.rng)
            gains = gains + self.occupancy.scores(poses.R, poses.t, there.points)
        return np.argsort(-gains, kind="stable")

    def _refine(
        self,
        poses: Poses,
        sample: Sample,
        widths: tuple[float, float, int],
        surface: Surface | None = None,
        rims: bool = True,
    ) -> Poses:
        first, last, steps = widths
        falling = np.geomspace(first, last, steps) * self.size
        tree = self.edge_tree if rims else None
        on = self.surface if surface is None else surface
        return Poses(*refine(poses.R, poses.t, sample, on, tree, falling, self.table.edges))

    def _everywhere(self, count: int) -> Sample:
        """Points of the whole scan, and rare ones: where the width is small, no normal need speak for a point."""
        some = Sample.of(self.places, count // 2, self.rng)
        points = np.concatenate([self.scan.thinned(count // 2).points, some.points, some.rims])
        return Sample(points, np.zeros_like(points), points[:0], points[:0])

    def _judgement(self, poses: Poses, count: int, floor: float) -> Judgement:
        least = max(width_floor(self.scan, self.surface), floor * self.size)
        if isinstance(self.target, Mesh):
            points = self.scan.points[sample_rows(len(self.scan), count)]
            return weigh_up(poses.R, poses.t, points, self.surface, self.limit, least)
        faces = np.flatnonzero(~self.places.is_rim)
        faces = faces[sample_rows(len(faces), count)]
        width = max(2.0 * self.scan.noise, self.scan.spacing, least)
        places = self.places.points[faces], self.places.directions[faces]
        return weigh_up(poses.R, poses.t, places[0], self.surface, self.limit, width, places[1])

    def _ranked(self, poses: Poses, count: int, floor: float, margin: float) -> Poses:
        """By falling likelihood; without those that are too far behind."""
        if not len(poses):
            return poses
        means = self._judgement(poses, count, floor).means
        order = np.argsort(-means, kind="stable")
        near = means[order] >= means[order[0]] - margin
        near[:KEPT_ANYWAY] |= margin >= HOPELESS
        return poses[order[near]]

    def _distinct(self, poses: Poses, apart: tuple[float, float], most: int) -> Poses:
        middle = self.scan.points.mean(axis=0)
        return poses[distinct(poses.R, poses.t, middle, apart[0], apart[1] * self.size, most)]


def _turned_round(task: _Task) -> tuple[_Task, Callable[[Poses], Poses]]:
    """The task from the larger cloud to the smaller side, and what turns its poses back."""
    if isinstance(task.target, Mesh) or task.table.size <= SCENE * task.scan.diagonal:
        return task, lambda poses: poses
    # The smaller side has pairs and a grid of its own size, so it is what is looked for in the larger one.
    signed = task.scan.oriented and task.scan.fitted is None
    part = PointCloud(task.scan.points, task.scan.normals if signed else None)
    surface = CloudSurface(part)
    scene, table = prepare_scan(task.target, COARSE), PairTable.of(part, surface)
    return _Task(scene, surface, part, task.plan, table, task.rng), lambda poses: poses.inverse


def _candidate(T: FloatArray, judgement: Judgement, row: int, stage: str, words: str) -> Candidate:
    rms = float(np.sqrt((judgement.distances[row] ** 2).mean()))
    return Candidate(pose.from_parts(T[:3, :3], T[:3, 3]), float(-judgement.means[row]), rms, stage, words)
