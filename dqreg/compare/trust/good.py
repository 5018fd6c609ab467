"""Good tasks: the right pose ought to be accepted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.compare.trust import scans, shapes
from dqreg.compare.trust.task import Kind, Make, TrustTask, kinds_of, on_part
from dqreg.geometry import Mesh
from dqreg.synth import Scene

Scan = Callable[[Mesh, np.random.Generator], FloatArray]


def of(scan: Scan, noise: float = scans.NOISE_DIAGONALS, family: shapes.Family | None = None, **options: Any) -> Make:
    """Task of a scan of any part."""

    def make(rng: np.random.Generator) -> TrustTask:
        mesh = shapes.any_part(rng) if family is None else shapes.draw(family, rng)
        return on_part(scan(mesh, rng), mesh, rng, noise=noise, **options)

    return make


def noisy(noise: float) -> Scan:
    """Two views with so much noise."""
    return lambda mesh, rng: scans.two_views(mesh, rng, noise)


def strays(share: float) -> Scan:
    """Two views with so large a share of outliers."""
    return lambda mesh, rng: scans.with_strays(scans.two_views(mesh, rng), share, rng)


def few(low: int, high: int) -> Scan:
    """Some touched points all over the part."""
    return lambda mesh, rng: scans.sampled(mesh, int(rng.integers(low, high)), rng, 1e-4)


def _on_table(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    around = Scene(kind="table", size=2.0, clutter=int(rng.integers(0, 3))).surroundings(
        mesh.vertices, np.random.default_rng(rng.integers(2**31))
    )
    towards = np.array([rng.normal(), rng.normal(), rng.uniform(0.6, 1.5)])
    scan = scans.in_scene(mesh, around, np.stack([towards, towards * [-1.0, -1.0, 1.0]]), rng)
    return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(5.0, 0.02))


def _far_away(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    scale, offset = 10.0 ** rng.uniform(-4, 1), rng.uniform(-1e6, 1e6, 3)
    moved = Mesh(mesh.vertices * scale + offset, mesh.faces)
    scan = scans.sampled(moved, int(rng.integers(600, 2000)), rng, 1e-3)
    return on_part(scan, moved, rng, noise=1e-3)


KINDS: tuple[Kind, ...] = kinds_of(
    "good",
    True,
    ("two-views", "camera, two views", of(scans.two_views)),
    ("one-view", "camera, one view", of(scans.one_view)),
    ("depth-camera", "depth steps, flying pixels, lost returns", of(scans.depth_camera, 1e-3)),
    ("light-stripes", "structured light from two places", of(scans.light_stripes)),
    ("lidar-rings", "24 rings from two places", of(scans.rings, 1e-3)),
    ("few-points", "40 to 120 touched points, start 3 degrees off", of(few(40, 120), 1e-4, start=(3.0, 0.01))),
    ("some-points", "120 to 400 points all over", of(few(120, 400), 1e-4)),
    ("noise-1e-3", "noise of 0.1 % of the size", of(noisy(1e-3), 1e-3)),
    ("noise-3e-3", "noise of 0.3 % of the size", of(noisy(3e-3), 3e-3)),
    ("strays-10", "10 % strays", of(strays(0.1))),
    ("strays-30", "30 % strays", of(strays(0.3))),
    ("start-5-2", "start 5 degrees and 2 % off", of(scans.two_views, start=(5.0, 0.02))),
    ("start-15-10", "start 15 degrees and 10 % off", of(scans.two_views, start=(15.0, 0.1))),
    ("nothing", "no initial pose, two views", of(scans.two_views, start=None)),
    ("nothing-one-view", "no initial pose, one view", of(scans.one_view, start=None)),
    ("nothing-strays-30", "no initial pose, 30 % strays", of(strays(0.3), start=None)),
    ("plates", "flat plate with holes", of(scans.two_views, family=shapes.plate)),
    ("on-a-table", "part on a table with clutter", _on_table),
    ("far-coordinates", "any unit, up to 1e6 from the origin", _far_away),
)
