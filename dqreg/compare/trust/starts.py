"""Bad initial poses, poor views and strays: the scan is of the part, the pose at hand is not right."""

from __future__ import annotations

import numpy as np

from dqreg.compare.trust import scans, shapes
from dqreg.compare.trust.task import Kind, Make, TrustTask, kinds_of, on_part
from dqreg.rigid import pose


def from_far(low: float, high: float, shift: float, *, search: bool = True, strays: float = 0.0) -> Make:
    """A start so many degrees and diagonals off; without the second try where it is forbidden."""

    def make(rng: np.random.Generator) -> TrustTask:
        mesh = shapes.any_part(rng)
        scan = scans.two_views(mesh, rng)
        if strays:
            scan = scans.with_strays(scan, strays, rng)
        # A named method never searches: the answer of the loop itself is judged.
        options = {} if search else {"method": "plane"}
        start = (rng.uniform(low, high), shift)
        return on_part(scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=start, options=options)

    return make


def _shifted(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    return on_part(
        scans.two_views(mesh, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=(5.0, rng.uniform(0.2, 0.6)),
        options={"method": "plane"},
    )  # fmt: skip


def _half_turn(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    flip = pose.about(pose.exp(np.concatenate([np.pi * np.eye(3)[rng.integers(3)], np.zeros(3)])), mesh.centre)
    options = {"method": "plane"} if rng.uniform() < 0.5 else {}
    return on_part(
        scans.two_views(mesh, rng),
        mesh,
        rng,
        noise=scans.NOISE_DIAGONALS,
        start=(5.0, 0.02),
        T_off=flip,
        options=options,
    )


def _with_distance(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    reach = mesh.diagonal * rng.choice([0.01, 0.02, 0.05])
    return on_part(
        scans.one_view(mesh, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=(rng.uniform(30, 180), 0.1),
        options={"max_distance": float(reach)},
    )  # fmt: skip


def _few_touched(rng: np.random.Generator) -> TrustTask:
    mesh = shapes.any_part(rng)
    count = int(rng.integers(8, 25))
    return on_part(
        scans.sampled(mesh, count, rng), mesh, rng, noise=scans.NOISE_DIAGONALS, start=(rng.uniform(20, 60), 0.1)
    )


def _one_sided(rng: np.random.Generator) -> TrustTask:
    """Nearly all points on one flat face, a few elsewhere, from a start that slid along it."""
    mesh = shapes.draw(shapes.steps, rng)
    floor = scans.sampled(mesh, 8000, rng)
    bottom = mesh.vertices[:, 2].min() + 2e-3 * mesh.diagonal
    flat, rest = floor[floor[:, 2] < bottom], floor[floor[:, 2] >= bottom]
    scan = np.concatenate([flat[: int(rng.integers(600, 1500))], rest[: int(rng.integers(10, 40))]])
    slide = pose.exp(np.concatenate([np.zeros(3), rng.normal(size=2) * 0.08 * mesh.diagonal, [0.0]]))
    return on_part(
        scan, mesh, rng, noise=scans.NOISE_DIAGONALS, start=(1.0, 0.005), T_off=slide, options={"method": "plane"}
    )


KINDS: tuple[Kind, ...] = kinds_of(
    "starts",
    False,
    ("start-60-180", "start 60 to 180 degrees off", from_far(60, 180, 0.1)),
    ("start-60-180-loop", "the same, without a search", from_far(60, 180, 0.1, search=False)),
    ("start-20-60-loop", "start 20 to 60 degrees off, without a search", from_far(20, 60, 0.1, search=False)),
    ("start-shifted", "start shifted by 20 to 60 % of the size, without a search", _shifted),
    ("start-half-turn", "start turned by half a turn about an axis of its box", _half_turn),
    ("max-distance", "bad start and a small max_distance", _with_distance),
    ("strays-60", "60 % strays, start 20 to 60 degrees off", from_far(20, 60, 0.1, strays=0.6)),
    ("few-touched", "8 to 25 points, start 20 to 60 degrees off", _few_touched),
    ("one-face", "nearly all points on one flat face", _one_sided),
)
