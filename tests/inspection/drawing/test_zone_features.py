"""Features of a scan by minimum zone, inscribed and circumscribed shapes, against faults that were made."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import Deviations, inspect, measure_deviations, part_faces
from dqreg.inspection.plan.file import plan_of
from dqreg.synth.parts import cylinder

RADIUS, HEIGHT, NOISE, LOBES = 8.0, 10.0, 0.01, 0.04
PIN = Mesh(*cylinder(diameter=2.0 * RADIUS, height=HEIGHT, segments=96))
FACES = part_faces(PIN)
WALL = next(face.number for face in FACES if face.kind == "cylinder")
TOP, BOTTOM = (face.number for face in sorted(FACES, key=lambda face: -face.centre[2]) if face.kind == "plane")
SURFACE = MeshSurface(PIN)
# Of three lobes the pin within, the ring about, and the middle of both.
MADE = {"inscribed": -LOBES, "circumscribed": LOBES, "minimum-zone": 0.0, "gauss": 0.0}


def scanned(seed: int, share: float = 1.0) -> Deviations:
    rng = np.random.default_rng(seed)
    turn, z = rng.uniform(0.0, 2.0 * np.pi * share, 1_400), rng.uniform(-0.5 * HEIGHT, 0.5 * HEIGHT, 1_400)
    r = RADIUS + 0.5 * LOBES * np.cos(3.0 * turn) + rng.normal(0.0, NOISE, 1_400)
    wall = np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
    turn, r = rng.uniform(0.0, 2.0 * np.pi, 800), RADIUS * np.sqrt(rng.uniform(0.0, 1.0, 800))
    side = np.repeat([-0.5, 0.5], 400) * HEIGHT + rng.normal(0.0, NOISE, 800)
    ends = np.column_stack([r * np.cos(turn), r * np.sin(turn), side])
    return measure_deviations(np.vstack([wall, ends]), PIN, SURFACE, reach=1.0)


def diameters(seed: int, fits: tuple[str, ...]) -> np.ndarray:
    """Error and uncertainty of each."""
    rows = [{"kind": "diameter", "face": WALL, "fit": fit, "tolerance": 0.1} for fit in fits]
    found = inspect(scanned(seed), plan_of({"characteristic": rows})).characteristics
    assert [row.fit for row in found] == list(fits)
    return np.array([[row.value - 2.0 * RADIUS - MADE[row.fit], row.uncertainty] for row in found])


@pytest.mark.parametrize(("first", "runs"), [(9_000, 1), pytest.param(12_500, 200, marks=pytest.mark.soak)])
def test_diameters_are_within_their_stated_uncertainty(first: int, runs: int) -> None:
    fits = tuple(MADE) if runs > 1 else ("inscribed",)
    found = np.array([diameters(seed, fits) for seed in range(first, first + runs)])
    inside = (np.abs(found[..., 0]) <= found[..., 1]).sum(axis=0)
    # k = 2 promises 95.4 %: of 200 runs fewer than 182 inside have a chance below 0.5 %.
    assert (inside >= (182 if runs == 200 else runs)).all(), dict(zip(fits, inside.tolist(), strict=True))
    # A pin of three lobes is no narrower than its ring.
    assert (found[..., 1] < LOBES).all()


def test_a_datum_by_the_minimum_zone() -> None:
    plan: dict[str, Any] = {
        "alignment": "best-fit",
        "datum": [{"name": "A", "face": BOTTOM, "fit": "minimum-zone"}],
        "characteristic": [
            {"kind": "parallelism", "face": TOP, "datum": "A", "tolerance": 0.1},
            {"kind": "distance", "faces": [TOP, BOTTOM], "tolerance": 0.1},
        ],
    }
    parallel, height = inspect(scanned(3), plan_of(plan)).characteristics
    assert abs(height.value - HEIGHT) <= height.uncertainty < 0.02
    assert parallel.value <= parallel.uncertainty < 0.05


def test_what_cannot_be_fitted_is_named() -> None:
    def refused(**row: Any) -> str:
        with pytest.raises(InputError) as told:
            inspect(scanned(1), plan_of({"characteristic": [{"name": "it", "tolerance": 1, **row}]}))
        return str(told.value)

    assert "characteristic 1 (it): fit must be one of gauss, minimum-zone" in refused(
        kind="diameter", face=WALL, fit="max"
    )
    assert "fit goes with diameter, distance" in refused(kind="form", face=WALL, fit="inscribed")
    told = refused(kind="distance", faces=[TOP, BOTTOM], fit="inscribed")
    assert told.startswith("characteristic 'it': fit = \"inscribed\" is of cylinders and spheres; a plane has neither")
    rows = [{"name": "half", "kind": "diameter", "face": WALL, "fit": "inscribed", "tolerance": 1}]
    (row,) = inspect(scanned(1, share=0.4), plan_of({"characteristic": rows})).characteristics
    assert "the inscribed cylinder has no largest size" in row.remark
    with pytest.raises(InputError, match="datum 1: fit must be one of"):
        plan_of({"datum": [{"name": "A", "face": 0, "fit": "least"}], "tolerance": 1})
