"""The tasks of the report that no kind of the trust sweep stands for, as they were reported."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust import chance, good, scans, shapes
from dqreg.compare.trust.task import Kind, TrustTask, on_part
from dqreg.compare.trust.trial import Trial, is_right, trial
from dqreg.geometry import Mesh, PointCloud
from dqreg.geometry.opening import as_geometry
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.synth import Lidar, Motion, Noise, random_pose, scan_mesh
from dqreg.synth.parts import box, bracket, flange, gear
from dqreg.synth.parts.kinds import about_z

CAD = (
    "1002_tray_bottom.STL", "ADIS16480.STL", "angle_block.STL", "featuretype.STL", "idler_riser.STL",
    "plate_holes.STL", "fixed_top.ply", "octagonal_pocket.ply", "counterXP.3MF", "cycloidal.ply",
)  # fmt: skip
# Range scans of a figure of which at most 3 % of one lies within a millimetre of the other, by their stored poses.
OPPOSITE = (
    ("bun000", "bun180"), ("bun045", "bun180"), ("bun090", "bun270"), ("bun000", "ear_back"), ("bun315", "ear_back"),
    ("chin", "top2"),
)  # fmt: skip
# Displacement, in diagonals, that a limit may cost against the start; and that a moved gear may be off.
WORSE, OFF = 1e-3, 0.01


def noise_cloud(rng: np.random.Generator) -> TrustTask:
    """60 to 400 points of Gauss, ball or shell on a box or a bracket, begun as the report says or from nothing."""
    mesh = Mesh(*(box((100.0, 60.0, 40.0)) if rng.uniform() < 0.5 else bracket()))
    shape = (chance.gauss, chance.ball, chance.shell)[rng.integers(3)]
    points = mesh.centre + 0.33 * mesh.diagonal * shape(int(rng.integers(60, 400)), rng)
    task = chance.unrelated(points, mesh, rng)
    return dataclasses.replace(task, options={"effort": "fast"} if rng.uniform() < 0.5 else {})


def block_on_half(rng: np.random.Generator) -> TrustTask:
    """A block of 160 laid on a block of 80."""
    other = rng.uniform(30.0, 70.0, 2)
    mesh, longer = Mesh(*box((80.0, *other))), Mesh(*box((160.0, *other)))
    shift = np.array([40.0 if rng.uniform() < 0.7 else 0.0, 0.0, 0.0])
    scan = scans.two_views(Mesh(longer.vertices + shift, longer.faces), rng)
    return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(4.0, 0.02), right=False)


def flipped_ring(rng: np.random.Generator) -> TrustTask:
    """A ring with bolts begun upside down about an axis in its plane that is not principal."""
    mesh = Mesh(*flange(hub_height=float(rng.uniform(1.0, 30.0)), bolts=int(rng.integers(3, 9))))
    angle = rng.uniform(0.0, np.pi)
    axis = np.array([np.cos(angle), np.sin(angle), 0.0])
    flip = pose.about(pose.exp(np.concatenate([np.pi * axis, np.zeros(3)])), mesh.centre)
    return on_part(scans.two_views(mesh, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=(3.0, 0.01), T_off=flip)


def moved_boss(rng: np.random.Generator) -> TrustTask:
    """A bracket of which the boss sits 3 % of the size beside its place."""
    sizes = {"length": rng.uniform(90, 150), "height": rng.uniform(60, 100), "width": rng.uniform(70, 110)}
    mesh = Mesh(*bracket(**sizes, boss_position=0.45))
    away = 0.03 * mesh.diagonal / sizes["width"]
    other = Mesh(*bracket(**sizes, boss_position=0.45 + away * rng.choice([-1.0, 1.0])))
    start = (8.0, 0.05) if rng.uniform() < 0.7 else None
    return on_part(scans.two_views(other, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=start)


def real_start(data: Path, degrees: float, share: float) -> Callable[[np.random.Generator], TrustTask]:
    """A virtual scan of a real part from a start so far off."""

    def make(rng: np.random.Generator) -> TrustTask:
        mesh = as_geometry(data / "trimesh_cad" / CAD[rng.integers(len(CAD))], "part")
        assert isinstance(mesh, Mesh)
        scan = scans.two_views(mesh, rng) if rng.uniform() < 0.7 else scans.one_view(mesh, rng)
        return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(degrees, share))

    return make


def figure_from_behind(data: Path) -> Callable[[np.random.Generator], TrustTask]:
    """Range scans from opposite sides of a figure, from nothing or from random starts; right by their stored poses."""

    def make(rng: np.random.Generator) -> TrustTask:
        folder = data / "stanford_bunny_range"
        names = rng.permutation(OPPOSITE[rng.integers(len(OPPOSITE))])
        source, target = (as_geometry(folder / f"{name}.ply", str(name)).points for name in names)
        one, other = (np.loadtxt(folder / f"T_world_{name}.txt") for name in names)
        T = pose.inverse(other) @ one
        size = float(np.linalg.norm(np.ptp(target, axis=0)))
        source, target = (points[rng.permutation(len(points))[:8000]] for points in (source, target))
        off = random_pose(rng, 0.3 * size, source.mean(axis=0))
        start = None if rng.uniform() < 0.5 else "identity"
        return TrustTask(
            pose.apply(pose.inverse(off), source), PointCloud(target), start, (T @ off)[None], target, size, 5e-4 * size
        )

    return make


def moved_gear(seed: int) -> Trial:
    """The gear of `datasets_synth/gear_motion`, scanned anew: accepted is wrong where it is 1 % off or more."""

    def make(rng: np.random.Generator) -> TrustTask:
        vertices, faces = gear(teeth=18, flank_facets=3)
        mesh = Mesh(vertices, faces)
        motion = Motion(turn_rad=tuple(np.deg2rad([0.5, -1.0, 4.0])), shift=(0.02, 0.0, -0.01), reference=1.0)
        scanner = Lidar(((1.0, 0.3, 0.9), (-0.8, -0.6, 0.8)), rings=40, azimuths=90)
        noise = Noise(range_sigma=0.03, mixed_share=0.4, mixed_step=0.02)
        scan = scan_mesh(vertices, faces, scanner, noise, rng=rng, motion=motion)
        task = on_part(scan.points, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(3.0, 0.01))
        return dataclasses.replace(task, truths=about_z(18) @ task.truths[0])

    one = trial(Kind("moved gear", "reported", False, "", make), seed)
    return dataclasses.replace(one, right=one.right and not one.error > OFF)


def beside_the_answer(*, started: bool) -> Callable[[int], Trial]:
    """A hole is an answer that is wrong while one of its alternatives is right."""

    def run(seed: int) -> Trial:
        rng = np.random.default_rng([7, seed, started])
        if started:
            mesh = shapes.any_part(rng)
            scan = scans.one_view(mesh, rng)
            off = random_pose(rng, 0.0, mesh.centre)
            task = on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(0.0, 0.0), T_off=off)
        else:
            found = good._on_table(rng)
            off = random_pose(rng, 0.2 * found.size, found.probes.mean(axis=0))
            task = dataclasses.replace(
                found, source=pose.apply(pose.inverse(off), found.source), start=None, truths=found.truths @ off
            )
        return _judged("truth beside", seed, task, lambda result: _holds_truth(result, task))

    return run


def within_a_limit(seed: int) -> Trial:
    """A hole is a pose that is farther from the truth than the start was."""
    rng = np.random.default_rng([8, seed])
    mesh = shapes.any_part(rng)
    task = on_part(
        scans.two_views(mesh, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=(rng.uniform(1.0, 12.0), 0.03)
    )
    limit = float(10.0 ** rng.uniform(-6.0, -0.7))
    task = dataclasses.replace(task, options={"time_limit": limit})
    begun = is_right(np.eye(4), task)[1]
    return _judged("time limit", seed, task, lambda result: is_right(result.T_target_source, task)[1] > begun + WORSE)


def _judged(name: str, seed: int, task: TrustTask, is_hole: Callable[[Registration], bool]) -> Trial:
    """A trial that counts as wrongly accepted where there is a hole, whatever the verdict says."""
    began = time.perf_counter()
    result = register(task.source, task.target, task.start, **task.options)
    seconds = time.perf_counter() - began
    right, off = is_right(result.T_target_source, task)
    verdict = result.verdict
    hole = is_hole(result)
    level = "accepted" if hole else verdict.level
    return Trial(
        name, seed, False, level, right and not hole, off, verdict.codes, str(verdict.reasons[0]), len(task.source),
        seconds,
    )  # fmt: skip


def _holds_truth(result: Registration, task: TrustTask) -> bool:
    right, _ = is_right(result.T_target_source, task)
    others: list[FloatArray] = [one.T_target_source for one in result.alternatives]
    return not right and any(is_right(T, task)[0] for T in others)
