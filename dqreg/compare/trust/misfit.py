"""Scans of something that resembles the target: another size, shape or part, or more than the part."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust import scans, shapes
from dqreg.compare.trust.task import Kind, Make, TrustTask, kinds_of, on_part
from dqreg.geometry import Mesh, sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts import box

Change = Callable[[FloatArray, np.random.Generator], FloatArray]


def changed(change: Change, start: tuple[float, float] | None = (8.0, 0.03)) -> Make:
    """A scan of the part after a change of its vertices about its middle, in units of its half extents."""

    def make(rng: np.random.Generator) -> TrustTask:
        mesh = shapes.any_part(rng)
        half = 0.5 * np.ptp(mesh.vertices, axis=0)
        fine = shapes.finer(mesh)
        other = Mesh(mesh.centre + half * change((fine.vertices - mesh.centre) / half, rng), fine.faces)
        from_start = start if rng.uniform() < 0.7 else None
        return on_part(
            scans.two_views(other, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=from_start, right=False
        )

    return make


def one_axis(low: float, high: float) -> Change:
    """Longer or shorter along one axis."""

    def change(x: FloatArray, rng: np.random.Generator) -> FloatArray:
        factors = np.ones(3)
        factors[rng.integers(3)] += rng.uniform(low, high) * rng.choice([-1.0, 1.0])
        return x * factors

    return change


def scaled(low: float, high: float) -> Change:
    """Larger or smaller."""
    return lambda x, rng: x * (1.0 + rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def _sheared(x: FloatArray, rng: np.random.Generator) -> FloatArray:
    i, j = rng.choice(3, 2, replace=False)
    moved = x.copy()
    moved[:, i] += rng.uniform(0.03, 0.08) * rng.choice([-1.0, 1.0]) * x[:, j]
    return moved


def _bent(x: FloatArray, rng: np.random.Generator) -> FloatArray:
    i, j = rng.choice(3, 2, replace=False)
    moved = x.copy()
    moved[:, i] += rng.uniform(0.05, 0.12) * rng.choice([-1.0, 1.0]) * x[:, j] ** 2
    return moved


def _twisted(x: FloatArray, rng: np.random.Generator) -> FloatArray:
    i = int(rng.integers(3))
    j, k = (i + 1) % 3, (i + 2) % 3
    turn = np.deg2rad(rng.uniform(4, 12)) * rng.choice([-1.0, 1.0]) * x[:, i]
    moved = x.copy()
    moved[:, j] = np.cos(turn) * x[:, j] - np.sin(turn) * x[:, k]
    moved[:, k] = np.sin(turn) * x[:, j] + np.cos(turn) * x[:, k]
    return moved


def _mirrored(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    flip = np.ones(3)
    flip[rng.integers(3)] = -1.0
    other = Mesh(mesh.centre + flip * (mesh.vertices - mesh.centre), mesh.faces[:, ::-1])
    start = (8.0, 0.03) if rng.uniform() < 0.5 else None
    return on_part(scans.two_views(other, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=start, right=False)


def _another(rng: np.random.Generator, *, same_family: bool = False, points: int | None = None) -> TrustTask:
    mesh = shapes.any_part(rng)
    family = shapes.ASYMMETRIC[rng.integers(len(shapes.ASYMMETRIC))]
    if same_family:
        family = shapes.ASYMMETRIC[int(rng.integers(len(shapes.ASYMMETRIC)))]
        mesh = shapes.draw(family, rng)
    other = shapes.draw(family, rng)
    other = Mesh((other.vertices - other.centre) * (mesh.diagonal / other.diagonal) + mesh.centre, other.faces)
    scan = scans.two_views(other, rng) if points is None else scans.sampled(other, points, rng)
    start = (8.0, 0.03) if rng.uniform() < 0.5 else None
    return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=start, right=False)


def _smaller(rng: np.random.Generator) -> TrustTask:
    """The same part much smaller, from nothing: it can hide inside a corner."""
    mesh = shapes.any_part(rng)
    other = Mesh((mesh.vertices - mesh.centre) * rng.uniform(0.5, 0.9) + mesh.centre, mesh.faces)
    return on_part(scans.two_views(other, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=None, right=False)


def _hull(rng: np.random.Generator) -> TrustTask:
    """The bounding box of the part instead of the part."""
    mesh = shapes.any_part(rng)
    vertices, faces = box(tuple(np.ptp(mesh.vertices, axis=0)))
    other = Mesh(vertices + mesh.centre, faces)
    return on_part(scans.two_views(other, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, right=False)


def _longer_block(rng: np.random.Generator) -> TrustTask:
    """A block up to twice as long as the target: a third to a half of the scan hangs in the air."""
    size = np.cumsum(rng.uniform(15, 50, 3))
    mesh = Mesh(*box(tuple(size)))
    longer = size.copy()
    axis = int(rng.integers(3))
    longer[axis] *= rng.uniform(1.4, 2.1)
    vertices, faces = box(tuple(longer))
    offset = np.zeros(3)
    offset[axis] = 0.5 * (longer - size)[axis] if rng.uniform() < 0.7 else 0.0
    scan = scans.two_views(Mesh(vertices + offset, faces), rng)
    return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(4.0, 0.02), right=False)


def _doubled(rng: np.random.Generator) -> TrustTask:
    """Two exposures, the second after the part had moved by some percent: neither is right for both."""
    mesh = shapes.any_part(rng)
    step = np.concatenate([np.deg2rad(rng.uniform(2, 6)) * scans.directions(1, rng)[0],
                           rng.uniform(0.02, 0.06) * mesh.diagonal * scans.directions(1, rng)[0]])  # fmt: skip
    T = pose.about(pose.exp(step), mesh.centre)
    scan = np.concatenate([scans.two_views(mesh, rng), pose.apply(T, scans.two_views(mesh, rng))])
    return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(4.0, 0.02), right=False)


def _during_motion(rng: np.random.Generator) -> TrustTask:
    """The part turned and moved while it was scanned, by more than can be called noise."""
    mesh = shapes.any_part(rng)
    points = sample_mesh(mesh, int(rng.integers(800, 3000)), rng).points
    points = points[np.argsort((points - mesh.centre) @ scans.directions(1, rng)[0])]
    twist = np.concatenate([np.deg2rad(rng.uniform(6, 15)) * scans.directions(1, rng)[0],
                            rng.uniform(0.05, 0.12) * mesh.diagonal * scans.directions(1, rng)[0]])  # fmt: skip
    steps = np.array_split(points, 40)
    scan = np.concatenate(
        [pose.apply(pose.about(pose.exp((k / 39 - 0.5) * twist), mesh.centre), s) for k, s in enumerate(steps)]
    )
    scan += scans.NOISE_DIAGONALS * mesh.diagonal * rng.normal(size=scan.shape)
    return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(3.0, 0.01), right=False)


KINDS: tuple[Kind, ...] = kinds_of(
    "misfit",
    False,
    ("longer-5-20", "5 to 20 % longer or shorter along one axis", changed(one_axis(0.05, 0.2))),
    ("stretched-3-5", "3 to 5 % longer or shorter along one axis", changed(one_axis(0.03, 0.05))),
    ("scaled-1", "1 to 1.5 % larger or smaller", changed(scaled(0.01, 0.015))),
    ("scaled-3", "3 to 5 % larger or smaller", changed(scaled(0.03, 0.05))),
    ("sheared", "sheared by 3 to 8 %", changed(_sheared)),
    ("bent", "bent by 2 to 6 % of its width", changed(_bent)),
    ("twisted", "ends twisted against each other by 8 to 24 degrees", changed(_twisted)),
    ("mirrored", "the mirror image", _mirrored),
    ("another-part", "another part of the same size", _another),
    ("same-family", "the same kind of part with other dimensions", lambda rng: _another(rng, same_family=True)),
    ("another-50-points", "50 points of another part", lambda rng: _another(rng, points=50)),
    ("much-smaller", "the same part at 50 to 90 % of its size, from nothing", _smaller),
    ("bounding-box", "the bounding box of the part", _hull),
    ("longer-block", "a third to a half of the scan lies beyond the target", _longer_block),
    ("two-exposures", "half of the scan taken after the part had moved by 2 to 6 %", _doubled),
    ("moved-during-scan", "part moved by 5 to 12 % during the sweep", _during_motion),
)
