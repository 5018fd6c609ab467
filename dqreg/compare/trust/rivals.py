"""Poses that fit as well, or nearly so: periods, flips, mirrored and repeated shapes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from dqreg.compare.trust import periodic, scans, shapes
from dqreg.compare.trust.periodic import Periodic
from dqreg.compare.trust.task import Kind, Make, TrustTask, kinds_of, on_part
from dqreg.geometry import Mesh, MeshSurface, PointCloud
from dqreg.rigid import pose
from dqreg.search.axes import cube_rotations

Family = Callable[[np.random.Generator], Periodic]


def one_off(family: Family) -> Make:
    """The whole part, from a start that is one or two periods off."""

    def make(rng: np.random.Generator) -> TrustTask:
        part = family(rng)
        period = np.linalg.matrix_power(part.period, int(rng.choice([-2, -1, 1, 2])))
        size = part.mesh.diagonal
        start = (1.0, 0.1 * part.cell / size)
        return on_part(
            scans.two_views(part.mesh, rng), part.mesh, rng, noise=scans.NOISE_DIAGONALS, start=start, T_off=period
        )

    return make


def middle_of(family: Family) -> Make:
    """A piece of the middle: every period fits as well, nothing may be accepted and the others are to be named."""

    def make(rng: np.random.Generator) -> TrustTask:
        part = family(rng)
        scan = scans.sampled(part.mesh, 6000, rng)
        scan = scan[scan[:, 2] > part.mesh.vertices[:, 2].min() + 0.01 * part.mesh.diagonal]
        away = np.linalg.norm((scan - part.middle)[:, :2], axis=1)
        if abs(part.period[2, 2] - 1.0) < 1e-9 and part.period[2, 3]:
            # Along the slope of stairs, or the axis of a rod.
            along = part.period[:3, 3] / np.linalg.norm(part.period[:3, 3])
            away = np.abs((scan - part.middle) @ along)
        scan = scans.thinned(scan[away < 1.2 * part.cell], rng, 300, 2500)
        start = (1.0, 0.1 * part.cell / part.mesh.diagonal)
        rivals = np.stack([part.period, pose.inverse(part.period)])
        return on_part(scan, part.mesh, rng, noise=scans.NOISE_DIAGONALS, start=start, right=False, rivals=rivals)

    return make


def _tooth_off(rng: np.random.Generator) -> TrustTask:
    """A flange with one larger hole, or none: begun one bolt off."""
    flange = shapes.draw(shapes.flange, rng)
    size = flange.diagonal
    # A block on the rim tells the bolts apart.
    low, high = flange.vertices.min(axis=0), flange.vertices.max(axis=0)
    block = scans.block_at(np.array([0.4 * high[0], 0.2 * high[1], 0.3 * (high[2] - low[2])]), 0.04 * size)
    mesh = shapes.joined(flange, block)
    step = 2 * np.pi / int(rng.integers(4, 10)) * rng.choice([-1.0, 1.0])
    turn = pose.exp(np.array([0.0, 0.0, step, 0.0, 0.0, 0.0]))
    return on_part(scans.two_views(mesh, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=(1.0, 0.005), T_off=turn)


def _flipped(rng: np.random.Generator) -> TrustTask:
    """A plate or a notched block, begun upside down."""
    mesh = shapes.draw(shapes.plate, rng) if rng.uniform() < 0.5 else _notched(rng)
    axis = np.eye(3)[rng.integers(3)] if rng.uniform() < 0.7 else scans.directions(1, rng)[0]
    flip = pose.about(pose.exp(np.concatenate([np.pi * axis, np.zeros(3)])), mesh.centre)
    return on_part(scans.two_views(mesh, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=(3.0, 0.01), T_off=flip)


def _notched(rng: np.random.Generator) -> Mesh:
    size = np.sort(rng.uniform(20, 90, 3))
    cut = rng.uniform(0.1, 0.3) * size[0]
    x, y = (np.array([0.0, length - cut, length]) for length in size[1:])
    return shapes.relief(x, y, np.array([[size[0], size[0]], [size[0], size[0] - cut]]))


def _notch_unseen(rng: np.random.Generator) -> TrustTask:
    """A notched block of which all but the notch's corner is scanned: poses fit as well that it alone would tell."""
    mesh = _notched(rng)
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    scan = scans.sampled(mesh, 3000, rng)
    corner = np.linalg.norm((scan - high) / (high - low), axis=1)
    half_turns = [pose.about(pose.from_parts(np.diag(s), np.zeros(3)), mesh.centre)
                  for s in ([1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0])]  # fmt: skip
    # What a half-turn would bring to the notch, or off the part, must be unseen as well.
    seen, surface = corner > 0.45, MeshSurface(mesh)
    for turn in half_turns:
        turned = pose.apply(turn, scan)
        seen &= np.linalg.norm((turned - high) / (high - low), axis=1) > 0.45
        seen &= surface.closest(turned).distances <= 4.0 * scans.NOISE_DIAGONALS * mesh.diagonal
    return on_part(scan[seen], mesh, rng, noise=scans.NOISE_DIAGONALS, right=False, rivals=np.stack(half_turns))


def _corner_of_box(rng: np.random.Generator) -> TrustTask:
    """One corner of a block: it fits at every other corner too."""
    mesh = shapes.draw(shapes.box, rng)
    scan = scans.sampled(mesh, 20_000, rng)
    corner = mesh.vertices.max(axis=0)
    reach = 0.7 * np.ptp(mesh.vertices, axis=0).min()
    scan = scans.thinned(scan[np.linalg.norm(scan - corner, axis=1) < reach], rng, 300, 2000)
    # The piece looks the same along its three edges: each of the 24 rotations of a cube puts it into some corner.
    half, out = 0.5 * np.ptp(mesh.vertices, axis=0), np.ones(3)
    turns = [R for R in cube_rotations() if not np.allclose(R, np.eye(3))]
    rivals = np.stack([pose.from_parts(R, mesh.centre + half * (R @ out) - R @ corner) for R in turns])
    return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(3.0, 0.01), right=False, rivals=rivals)


def _corner_of_cloud(rng: np.random.Generator) -> TrustTask:
    """The same with a cloud of the whole block as the target."""
    task = _corner_of_box(rng)
    assert isinstance(task.target, Mesh)
    return dataclasses.replace(task, target=PointCloud(scans.sampled(task.target, 8_000, rng)))


def _fewer_steps(rng: np.random.Generator) -> TrustTask:
    """Stairs of which only some steps were scanned, and nothing that a step up or down would put off them."""
    part = periodic.stairs(rng)
    along = part.period[:3, 3] / np.linalg.norm(part.period[:3, 3])
    scan = scans.one_view(part.mesh, rng)
    seen = np.abs((scan - part.middle) @ along) < 1.3 * part.cell
    surface, rivals = MeshSurface(part.mesh), np.stack([part.period, pose.inverse(part.period)])
    for T in rivals:
        seen &= surface.closest(pose.apply(T, scan)).distances <= 4.0 * scans.NOISE_DIAGONALS * part.mesh.diagonal
    start = (1.0, 0.005)
    return on_part(scan[seen], part.mesh, rng, noise=scans.NOISE_DIAGONALS, start=start, right=False, rivals=rivals)


KINDS: tuple[Kind, ...] = kinds_of(
    "rivals",
    False,
    ("stairs-off", "stairs, start one or two steps off", one_off(periodic.stairs)),
    ("pegs-off", "plate of pegs, start one or two pegs off", one_off(periodic.pegs)),
    ("rack-off", "toothed rack, start one or two teeth off", one_off(periodic.rack)),
    ("thread-off", "threaded rod, start half a turn and half a pitch off", one_off(periodic.thread)),
    ("pegs-middle", "middle of a lattice: any cell fits", middle_of(periodic.pegs)),
    ("rack-middle", "middle of a rack: any tooth fits", middle_of(periodic.rack)),
    ("stairs-middle", "middle of stairs: any step fits", _fewer_steps),
    ("thread-middle", "middle of a threaded rod: it screws", middle_of(periodic.thread)),
    ("bolt-off", "flange with a block on it, start turned about its axis", _tooth_off),
    ("flipped", "nearly symmetric part, start turned by 180 degrees", _flipped),
    ("notch-unseen", "the one place that tells two poses apart was not scanned", _notch_unseen),
    ("corner-of-box", "one corner of a block: it fits at each, three ways round", _corner_of_box),
    ("corner-of-cloud", "the same of a cloud of the block", _corner_of_cloud),
)
