"""From a cell of a sweep to its benchmark case: the virtual scan, its frame, its initial pose."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.case import BenchmarkCase, make_case
from dqreg.compare.sweep import FRAMES, Cell
from dqreg.compare.truth import TruePoses
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, disturbance, random_pose, scan_mesh
from dqreg.synth.parts import KINDS, symmetry_of

VIEW_DIRECTIONS = ((1.0, -0.8, 0.9), (0.9, 1.0, 0.7), (-0.45, 0.2, 1.0))
# About this fraction of the rays of a square image hits a part; points made at a time, for memory.
HIT_FRACTION, CHUNK_POINTS = 0.2, 300_000
TARGET_POINTS = 50_000


def build(cell: Cell, **options: Any) -> BenchmarkCase:
    """Benchmark case of a cell.

    The scan depends on part, points, noise, outliers and trial only: along an axis of initial poses it is the same.
    """
    part = _part(cell.part)
    scan_rng, pose_rng = (np.random.default_rng([cell.trial, stream]) for stream in (1, 2))
    target: Mesh | PointCloud = part
    if cell.overlap is None:
        scan = _scan(cell.part, cell.points, cell.noise, cell.outliers, cell.trial)
    else:
        scan, target = _two_scans(part, cell, scan_rng)
    T_truth = pose.inverse(random_pose(pose_rng, 0.8 * part.diagonal, part.centre))
    step = disturbance(pose_rng, np.deg2rad(cell.start_angle_deg), cell.start_offset * part.diagonal, part.centre)
    T_start = step @ T_truth
    source = pose.apply(pose.inverse(T_truth), scan)
    if cell.axis == "frame":
        # Coordinates far from the origin come with an initial pose near the identity, as from a surveyed scanner.
        source, T_truth, T_start = pose.apply(T_start, source), T_truth @ pose.inverse(T_start), np.eye(4)
    frame, symmetry = UnitFrame.named(cell.frame), symmetry_of(cell.part)
    axis = symmetry.axis
    truth = TruePoses(
        np.stack([frame.pose(symmetric @ T_truth) for symmetric in symmetry.poses]),
        None if axis is None else np.stack([frame.move(axis[0]), axis[1]]),
    )
    return make_case(
        cell.part,
        PointCloud(frame.move(source)),
        frame.target(target),
        None if cell.nothing else frame.pose(T_start),
        truth,
        setting=cell.setting,
        noise=cell.noise * part.diagonal * frame.scale,
        units=frame.units,
        axis=cell.axis,
        value=cell.value,
        trial=cell.trial,
        seed=cell.trial,
        **options,
    )


@dataclasses.dataclass(frozen=True, eq=False)
class UnitFrame:
    """Unit and origin of coordinates: p' = scale p + offset, for source and target alike."""

    units: str
    scale: float  # From millimetres
    offset: FloatArray  # (3,): Position of the old origin

    @staticmethod
    def named(name: str) -> UnitFrame:
        """Frame of a sweep."""
        units, scale, offset = FRAMES[name]
        return UnitFrame(units, scale, np.array(offset))

    def move(self, points: FloatArray) -> FloatArray:
        """Points in this frame. Shapes: points (..., 3), returns (..., 3)."""
        moved: FloatArray = self.scale * points + self.offset
        return moved

    def pose(self, T: FloatArray) -> FloatArray:
        """Pose between two frames that are both moved: R stays, t' = scale t + offset - R offset."""
        R = T[:3, :3]
        return pose.from_parts(R, self.scale * T[:3, 3] + self.offset - R @ self.offset)

    def target(self, target: Mesh | PointCloud) -> Mesh | PointCloud:
        """Target in this frame."""
        if isinstance(target, Mesh):
            return Mesh(self.move(target.vertices), target.faces)
        return PointCloud(self.move(target.points))


@functools.lru_cache(maxsize=4)
def _part(kind: str) -> Mesh:
    return Mesh(*KINDS[kind].build())


@functools.lru_cache(maxsize=12)
def _scan(kind: str, points: int, noise: float, outliers: float, trial: int) -> FloatArray:
    """Exactly so many points of a virtual scan, in the part's frame; large ones come from several passes."""
    part, rng = _part(kind), np.random.default_rng([trial, 1])
    error = Noise(range_sigma=noise * part.diagonal, outlier_share=outliers, max_incidence_rad=float(np.deg2rad(80.0)))
    passes: list[FloatArray] = []
    missing = points
    while missing > 0:
        wanted = min(missing, CHUNK_POINTS)
        pixels = int(np.ceil(np.sqrt(wanted / (HIT_FRACTION * len(VIEW_DIRECTIONS)))))
        # Each pass looks from a slightly different place, as a hand-held scanner does.
        views = np.array(VIEW_DIRECTIONS) + 0.03 * len(passes) ** 0.5 * rng.normal(size=(len(VIEW_DIRECTIONS), 3))
        scanner = Scanner(views=tuple(map(tuple, views.tolist())), pixels=pixels)
        found = scan_mesh(part.vertices, part.faces, scanner, error, rng=rng).points
        chosen = rng.permutation(len(found))[:wanted]
        passes.append(found[chosen])
        missing -= len(chosen)
    scan = np.concatenate(passes)
    scan.flags.writeable = False
    return scan


def _two_scans(part: Mesh, cell: Cell, rng: np.random.Generator) -> tuple[FloatArray, PointCloud]:
    """Two scans of the whole part, cut so that a known fraction of the first is in the second too."""
    overlap = 1.0 if cell.overlap is None else cell.overlap
    # Cut across a direction that no face of a part is likely to be square to.
    direction = np.array([0.8, 0.5, 0.33])
    kept = 1.0 / (2.0 - overlap)
    clouds = []
    for count, sign in ((cell.points, 1.0), (TARGET_POINTS, -1.0)):
        whole = sample_mesh(part, int(np.ceil(count / kept)), rng)
        assert whole.normals is not None
        along = sign * (whole.points @ direction)
        rows = np.argsort(along)[:count]
        shift = cell.noise * part.diagonal * rng.standard_normal((len(rows), 1))
        clouds.append(whole.points[rows] + shift * whole.normals[rows])
    outliers = rng.random(cell.points) < cell.outliers
    box = part.centre + 1.2 * (rng.random((cell.points, 3)) - 0.5) * np.ptp(part.bounds, axis=0)
    return np.where(outliers[:, None], box, clouds[0]), PointCloud(clouds[1])
