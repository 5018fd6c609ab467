"""Virtual scans of a part at random poses, for `from_nothing.py`, and whether a pose found for one is right."""

from __future__ import annotations

import dataclasses

import numpy as np

import dqreg
from dqreg.geometry import sample_mesh
from dqreg.icp import InlierMixture
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, random_pose, scan_mesh, worst_vertex_displacement

# Right: worst vertex in sizes; or, after a symmetry of the part, farthest place of it from itself; or mean
# log-likelihood of the judge's points behind the truth's; at most.
NEAR, SAME, AS_WELL = 0.02, 1e-3, 0.01
# Distance, in sizes, beyond which a point tells the judge nothing more; points of the judge.
LIMIT, JUDGES = 0.05, 20_000


@dataclasses.dataclass(frozen=True)
class Cell:
    """How a part is scanned: views, sigma of the range in sizes, share of uniform strays below 1, in words."""

    views: int
    noise: float
    outliers: float
    words: str


CELLS = {
    "two": Cell(2, 3e-4, 0.0, "two views"),
    "one": Cell(1, 3e-4, 0.0, "one view"),
    "noise": Cell(2, 3e-3, 0.0, "two views, noise 3e-3 S"),
    "strays": Cell(2, 3e-4, 0.3, "two views, 30 % strays"),
}


@dataclasses.dataclass(frozen=True)
class Case:
    """A scan in its own frame, a denser one from the same views that no method sees, and the truth."""

    points: np.ndarray
    held_out: np.ndarray
    T_truth: np.ndarray


def make_case(mesh: dqreg.Mesh, seed: int, cell: Cell, pixels: int) -> Case:
    rng = np.random.default_rng(seed)
    directions = [tuple(v) for v in rng.normal(size=(2, 3))[: cell.views]]
    sigma = Noise(range_sigma=cell.noise * mesh.diagonal)
    scans = [
        scan_mesh(mesh.vertices, mesh.faces, Scanner(directions, pixels=count), sigma, rng=draw).points
        for count, draw in ((pixels, rng), (5 * pixels // 3, np.random.default_rng(seed + 1_000_000)))
    ]
    low, high = scans[0].min(axis=0), scans[0].max(axis=0)
    strays = int(len(scans[0]) * cell.outliers / (1.0 - cell.outliers))
    room = 0.1 * (high - low)
    points = np.concatenate([scans[0], rng.uniform(low - room, high + room, size=(strays, 3))])
    T_truth = random_pose(rng, mesh.diagonal, mesh.centre)
    back = pose.inverse(T_truth)
    return Case(pose.apply(back, points), pose.apply(back, scans[1]), T_truth)


def is_right(T: np.ndarray, case: Case, mesh: dqreg.Mesh, target: dqreg.Target) -> bool:
    if not np.isfinite(T).all():
        return False
    if worst_vertex_displacement(T, case.T_truth, mesh.vertices) <= NEAR * mesh.diagonal:
        return True
    if _is_same(T @ pose.inverse(case.T_truth), mesh, target) and _is_same(
        case.T_truth @ pose.inverse(T), mesh, target
    ):
        return True
    held_out = case.held_out[:: max(1, len(case.held_out) // JUDGES)]
    ours, truth = (_likelihood(pose.apply(each, held_out), mesh, target) for each in (T, case.T_truth))
    return ours >= truth - AS_WELL


def _is_same(T: np.ndarray, mesh: dqreg.Mesh, target: dqreg.Target) -> bool:
    # Corners and middles of all triangles: no wall of a small hole goes unseen; and samples, for faces without holes.
    even = sample_mesh(mesh, JUDGES, np.random.default_rng(0)).points
    places = np.concatenate([mesh.vertices, mesh.corners.mean(axis=1), even])
    distances = target.indexed.surface.closest(pose.apply(T, places) - target.indexed.origin).distances
    return bool(distances.max() <= SAME * mesh.diagonal)


def _likelihood(points: np.ndarray, mesh: dqreg.Mesh, target: dqreg.Target) -> float:
    # Width and share of the inliers are those under which this pose is likeliest: no pose is favoured.
    distances = target.indexed.surface.closest(points - target.indexed.origin).distances
    limit = LIMIT * mesh.diagonal
    near = distances < limit
    if not near.any():
        return -np.inf
    mixture = InlierMixture.starting(0.2 * limit, limit).fit(distances[near], floor=1e-6 * mesh.diagonal, rounds=100)
    return -mixture.mean_nll(distances[near], int(np.count_nonzero(~near)))
