"""A virtual part whose faults are known: every characteristic lies within its stated uncertainty as often as stated."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta

from dqreg.geometry import Mesh, MeshSurface
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection import inspect, measure_deviations, nearest_face, part_faces
from dqreg.inspection.plan.file import plan_of
from dqreg.rigid import pose, twist
from dqreg.synth import Scan, Scanner, form_error, moved_feature, scan_mesh
from dqreg.synth.parts import bracket

PART = Mesh(*bracket())
FACES, LABELS = part_faces(PART), faces_of(PART)[1]
SURFACE = MeshSurface(PART)
NOISE = 0.01
BOTTOM, FRONT, SIDE, TOP = (
    nearest_face(PART, FACES, p).number for p in ((60, 40, 0), (60, 0, 5), (120, 40, 5), (100, 40, 10))
)
HOLES = [f for f in FACES if f.feature and f.is_hole and abs(f.feature.axis[2]) > 0.9]
LARGE = next(f for f in HOLES if f.feature and f.feature.diameter > 15.0)
SMALL = next(f for f in HOLES if f.feature and f.feature.diameter < 10.0)
# What is wrong with the part, mm and degrees: waves on its bottom and lobes of a small hole, a thicker base, the large
# hole wider and moved, the front tilted.
WAVES, LOBES, THICKER, WIDER, MOVED, TILT_DEG = 0.03, 0.03, 0.05, 0.06, 0.04, 0.05

PLAN: dict[str, Any] = {
    "datum": [{"name": "A", "face": BOTTOM}, {"name": "B", "face": SIDE}, {"name": "C", "face": FRONT}],
    "characteristic": [
        {"name": "height", "kind": "distance", "faces": [BOTTOM, TOP], "tolerance": 0.1},
        {"name": "wall", "kind": "thickness", "face": TOP, "tolerance": 0.1},
        {"name": "hole", "kind": "diameter", "face": LARGE.number, "tolerance": 0.1},
        {"name": "hole place", "kind": "position", "face": LARGE.number, "tolerance": 0.1},
        {"name": "hole axis", "kind": "perpendicularity", "face": LARGE.number, "datum": "A", "tolerance": 0.1},
        {"name": "flat", "kind": "form", "face": BOTTOM, "tolerance": 0.1},
        {"name": "top flat", "kind": "form", "face": TOP, "tolerance": 0.1},
        {"name": "round", "kind": "form", "face": SMALL.number, "tolerance": 0.1},
        {"name": "front", "kind": "perpendicularity", "face": FRONT, "datum": "A", "tolerance": 0.1},
        {"name": "top", "kind": "profile", "face": TOP, "plus": 0.1, "minus": 0.0},
        {"name": "corner", "kind": "angle", "faces": [BOTTOM, FRONT], "tolerance": 0.1},
    ],
}


@cache
def base() -> Scan:
    """The faulty part without noise, seen from all around."""
    views = (
        (1, 1, 1),
        (-1, 1, 1),
        (1, -1, 1),
        (-1, -1, 1),
        (0, 0, 1),
        (1, 1, -1),
        (-1, -1, -1),
        (0, 0, -1),
        (0, -1, 0),
    )
    scan = scan_mesh(PART.vertices, PART.faces, Scanner(views=views, pixels=64), rng=np.random.default_rng(0))
    mesh = (PART.vertices, PART.faces)

    def on(number: int) -> np.ndarray:
        return np.flatnonzero(number == LABELS)

    assert LARGE.feature is not None
    assert SMALL.feature is not None
    scan = form_error(scan, mesh, on(BOTTOM), WAVES, waves=3)
    scan = form_error(scan, mesh, on(SMALL.number), LOBES, waves=3, axis=(SMALL.feature.point, SMALL.feature.axis))
    scan = moved_feature(scan, mesh, on(TOP), larger=THICKER)
    moved, axis = np.eye(4), (LARGE.feature.point, LARGE.feature.axis)
    moved[0, 3] = MOVED
    scan = moved_feature(scan, mesh, on(LARGE.number), moved, larger=WIDER / 2, axis=axis)
    tilt = pose.about(twist.exp([np.deg2rad(TILT_DEG), 0, 0, 0, 0, 0]), FACES[FRONT].centre)
    return moved_feature(scan, mesh, on(FRONT), tilt)


def truth() -> dict[str, float]:
    return {
        "height": 10.0 + THICKER,
        "wall": 10.0 + THICKER + WAVES / 2,
        "hole": 16.0 + WIDER,
        "hole place": 2 * MOVED,
        "hole axis": 0.0,
        "flat": WAVES,
        "top flat": 0.0,
        "round": LOBES,
        # The front is tilted about x: its height counts.
        "front": float(np.ptp(PART.corners[LABELS == FRONT][..., 2])) * np.sin(np.deg2rad(TILT_DEG)),
        # The zone reaches from 0 to 0.1 above: its middle lies where the top is.
        "top": 0.0,
        "corner": 90.0 - TILT_DEG,
    }


def run(seed: int) -> list[tuple[float, float]]:
    """Value and uncertainty of each characteristic on a scan with its own noise and pose."""
    rng, scan = np.random.default_rng(seed), base()
    points = scan.points + rng.normal(0.0, NOISE, (len(scan.points), 1)) * scan.normals
    off = twist.exp(np.r_[rng.normal(0.0, 2e-4, 3), rng.normal(0.0, 0.02, 3)])
    found = measure_deviations(pose.apply(off, points), PART, SURFACE, reach=2.0, noise=NOISE)
    return [(row.value, row.uncertainty) for row in inspect(found, plan_of(PLAN)).characteristics]


@pytest.mark.parametrize(("first", "runs"), [(9_000, 2), pytest.param(11_000, 400, marks=pytest.mark.soak)])
def test_values_lie_within_their_stated_uncertainty(first: int, runs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dqreg.inspection.scanned_part.scanned_part.part_faces", lambda mesh: FACES)
    found = np.array([run(seed) for seed in range(first, first + runs)])
    right = np.array(list(truth().values()))
    inside = np.abs(found[:, :, 0] - right) <= found[:, :, 1]
    lines = []
    for name, hits, values in zip(truth(), inside.sum(axis=0), np.moveaxis(found, 1, 0), strict=True):
        # Binomial interval of 95 % (Clopper and Pearson).
        low, high = beta.ppf(0.025, hits, runs - hits + 1), beta.ppf(0.975, hits + 1, max(runs - hits, 1e-9))
        lines.append(
            f"{name:12s} {hits / runs:.3f} [{low:.3f}, {high:.3f}] mean {values[:, 0].mean():.5f} "
            f"scatter {values[:, 0].std():.5f} U {values[:, 1].mean():.5f}"
        )
    # k = 2 promises 95.4 %: of 400 runs fewer than 370 inside have a chance below 0.5 %.
    assert (inside.sum(axis=0) >= (370 if runs == 400 else runs - 1)).all(), "\n".join(lines)
