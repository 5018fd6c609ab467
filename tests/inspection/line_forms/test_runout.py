"""Runout of a stepped shaft whose faults are known because they were made: eccentric, lobed, tapered, wobbling."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import inspect, measure_deviations, nearest_face, part_faces
from dqreg.inspection.plan.file import plan_of

# Radii of the datum, of the journal above it and of the end of the cone, and where they end along the axis.
LARGE, SMALL, FOOT, TIP, SHOULDER, NECK, END = 8.0, 5.0, 4.0, 2.0, 20.0, 40.0, 50.0
NOISE, SPACING = 0.005, 0.6
OUTLINE = [[0, 0], [LARGE, 0], [LARGE, SHOULDER], [SMALL, SHOULDER], [SMALL, NECK], [FOOT, NECK], [TIP, END], [0, END]]


@cache
def shaft() -> tuple[Mesh, MeshSurface, dict[str, int]]:
    made = trimesh.creation.revolve(np.array(OUTLINE), sections=96)
    part = Mesh(np.asarray(made.vertices), np.asarray(made.faces))
    places = {
        "datum": (LARGE, 0, 10.0),
        "journal": (SMALL, 0, 30.0),
        "cone": (3.0, 0, 45.0),
        "shoulder": (6.5, 0, SHOULDER),
    }
    return (
        part,
        MeshSurface(part),
        {name: nearest_face(part, part_faces(part), at).number for name, at in places.items()},
    )


def sheet(
    seed: int,
    rows: list[dict[str, Any]],
    *,
    off: float = 0.0,
    lobes: float = 0.0,
    taper: float = 0.0,
    wobble: float = 0.0,
) -> Any:
    """A plan on a shaft with a journal and cone off the datum's axis, lobes, a taper, and a shoulder that leans."""
    rng = np.random.default_rng(seed)
    part, surface, faces = shaft()

    def around(radius: float, low: float, high: float) -> tuple[np.ndarray, np.ndarray]:
        count = int(2.0 * np.pi * radius * (high - low) / SPACING**2)
        return rng.uniform(0.0, 2.0 * np.pi, count), rng.uniform(low, high, count)

    def swept(turn: np.ndarray, r: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.column_stack([r * np.cos(turn), r * np.sin(turn), z])

    turn, z = around(LARGE, 0.0, SHOULDER)
    scan = [swept(turn, LARGE + rng.normal(0.0, NOISE, len(z)), z)]
    turn, z = around(SMALL, SHOULDER, NECK)
    r = SMALL + 0.5 * lobes * np.cos(3.0 * turn) + taper * ((z - SHOULDER) / (NECK - SHOULDER) - 0.5)
    scan.append(swept(turn, r + rng.normal(0.0, NOISE, len(z)), z))
    scan[-1] += [off, 0.0, 0.0]
    turn, z = around(SMALL, NECK, END)
    scan.append(swept(turn, FOOT + (TIP - FOOT) * (z - NECK) / (END - NECK) + rng.normal(0.0, NOISE, len(z)), z))
    scan[-1] += [off, 0.0, 0.0]
    turn, z = around(0.5 * (SMALL + LARGE), SMALL, LARGE)
    r = np.sqrt(SMALL**2 + (LARGE**2 - SMALL**2) * rng.uniform(0.0, 1.0, len(z)))
    scan.append(swept(turn, r, SHOULDER + wobble * r * np.cos(turn) + rng.normal(0.0, NOISE, len(z))))
    found = measure_deviations(np.vstack(scan), part, surface, reach=1.0)
    named = [{"tolerance": 0.2, "datum": "A", "name": row["kind"], **row, "face": faces[row["face"]]} for row in rows]
    return inspect(found, plan_of({"datum": [{"name": "A", "face": faces["datum"]}], "alignment": "best-fit",
                                   "characteristic": named})).characteristics  # fmt: skip


def journal(kind: str, **more: Any) -> dict[str, Any]:
    return {"face": "journal", "kind": f"{kind}-runout", **more}


def shoulder(kind: str, **more: Any) -> dict[str, Any]:
    return {"face": "shoulder", "kind": f"{kind}-runout", **more}


# Of lobes of 0.03 on a journal that is 0.04 off the travel is read off its outline; the cone leans by 11.3 degrees.
TURNS = np.linspace(0.0, 2.0 * np.pi, 100_001)
BOTH = float(np.ptp(0.04 * np.cos(TURNS) + 0.015 * np.cos(3.0 * TURNS)))
CASES: dict[str, tuple[dict[str, float], list[tuple[dict[str, Any], float]]]] = {
    "good": ({}, [(journal("circular"), 0.0), (journal("total"), 0.0), (shoulder("total"), 0.0)]),
    "eccentric": ({"off": 0.05}, [
        (journal("circular"), 0.1), (journal("total"), 0.1),
        ({"face": "cone", "kind": "circular-runout"}, 0.1 * np.cos(np.arctan(0.2))),
        ({"face": "cone", "kind": "total-runout"}, 0.1 * np.cos(np.arctan(0.2))),
    ]),
    "lobed": ({"off": 0.04, "lobes": 0.03}, [(journal("circular"), BOTH), (journal("circular", at=[5, 0, 30]), BOTH)]),
    "tapered": ({"off": 0.02, "taper": 0.06}, [(journal("circular"), 0.04), (journal("total"), 0.1)]),
    "wobbling": ({"wobble": 0.005}, [(shoulder("total"), 0.08), (shoulder("circular", at=[7, 0, 20]), 0.07)]),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize(("first", "runs"), [(9_000, 2), pytest.param(12_000, 100, marks=pytest.mark.soak)])
def test_runout_is_within_its_stated_uncertainty(name: str, first: int, runs: int) -> None:
    faults, rows = CASES[name]
    found = [sheet(first + k, [row for row, _ in rows], **faults) for k in range(runs)]
    for k, (row, truth) in enumerate(rows):
        values = [(each[k].value, each[k].uncertainty) for each in found]
        assert all(0.0 < room < 0.03 for _, room in values), (row, values)
        held = sum(abs(value - truth) <= room for value, room in values)
        assert held >= 0.93 * runs, (row, truth, values)


def test_what_has_no_runout_is_named() -> None:
    def told(row: dict[str, Any], datum: str = "A") -> str:
        with pytest.raises(InputError) as error:
            sheet(0, [{**row, "datum": datum}])
        return str(error.value)

    assert "goes with roundness, straightness, circular-runout, not with total-runout" in told(
        journal("total", at=[5, 0, 30])
    )
    assert "direction goes with" in told(journal("circular", direction=[1, 0, 0]))
    assert "datum must be one of A" in told(journal("circular"), datum="B")
    assert "beyond what was scanned of the face" in told(journal("circular", at=[5, 0, 65]))
