"""Profile of a line: the outline of a section against faults that were made, and what a plan says of it."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.stats import beta

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import inspect, measure_deviations, nearest_face, part_faces
from dqreg.inspection.plan.file import plan_of
from dqreg.synth.parts import box

LENGTH, WIDTH, HEIGHT, NOISE, SPACING = 60.0, 40.0, 10.0, 0.01, 0.7
PART = Mesh(*box((LENGTH, WIDTH, HEIGHT)))
TOP = nearest_face(PART, part_faces(PART), (0, 0, 0.5 * HEIGHT)).number
SIDE = nearest_face(PART, part_faces(PART), (0.5 * LENGTH, 0, 0)).number
WAVE, LIFT, BENT = 0.04, 0.02, 0.03
SECTIONS = [
    {"name": "front", "point": [0, -0.4 * WIDTH, 0], "normal": [0, 1, 0]},
    {"name": "back", "point": [0, 0.4 * WIDTH, 0], "normal": [0, 2, 0]},
    {"name": "aside", "point": [0, 2.0 * WIDTH, 0], "normal": [0, 1, 0]},
]


@cache
def surface() -> MeshSurface:
    return MeshSurface(PART)


def sheet(seed: int, rows: list[dict[str, Any]], *, wave: float = 0.0, lift: float = 0.0) -> Any:
    """A plan on a box whose top has waves along x that fade from the back to the front, and lies too high."""
    rng = np.random.default_rng(seed)
    count = int(LENGTH * WIDTH / SPACING**2)
    x, y = rng.uniform(-0.5, 0.5, (2, count))
    z = 0.5 * HEIGHT + lift + wave * (0.5 + y) * np.cos(2.0 * np.pi * 2.0 * x) + rng.normal(0.0, NOISE, count)
    top = np.column_stack([LENGTH * x, WIDTH * y, z])
    y, z = rng.uniform(-0.5, 0.5, (2, int(WIDTH * HEIGHT / SPACING**2)))
    bent = BENT * np.sin(np.pi * z) * (y < 0.0)
    side = np.column_stack([0.5 * LENGTH + bent + rng.normal(0.0, NOISE, len(y)), WIDTH * y, HEIGHT * z])
    found = measure_deviations(np.vstack([top, side]), PART, surface(), reach=2.0)
    named = [
        {"kind": "line-profile", "name": row["section"], **({} if "plus" in row else {"tolerance": 0.2}), **row}
        for row in rows
    ]
    return inspect(found, plan_of({"section": SECTIONS, "characteristic": named}))


def values(seed: int) -> list[tuple[float, float, float]]:
    """Measured, uncertainty and what was made."""
    back, front = {"section": "back", "face": TOP}, {"section": "front", "face": TOP}
    made = [(WAVE, 0.0, back, 1.8 * WAVE), (WAVE, 0.0, front, 0.2 * WAVE), (0.0, 0.0, back, 0.0)]
    made += [(WAVE, LIFT, back, 2.0 * (0.9 * WAVE + LIFT)), (0.0, LIFT, front, 2.0 * LIFT)]
    # Of a zone from 0 to 0.1 above the nominal line the lowest wave is the farthest from its middle.
    made += [(WAVE, 0.0, {**back, "plus": 0.1, "minus": 0.0}, 2.0 * (0.05 + 0.9 * WAVE))]
    made += [(0.0, 0.0, {"section": "front", "face": SIDE}, 2.0 * BENT)]
    found = []
    for wave, lift, row, truth in made:
        line = sheet(seed, [row], wave=wave, lift=lift).characteristics[0]
        found.append((line.value, line.uncertainty, truth))
    return found


@pytest.mark.parametrize(("first", "runs"), [(9_000, 1), pytest.param(12_000, 100, marks=pytest.mark.soak)])
def test_an_outline_is_within_its_stated_uncertainty(first: int, runs: int) -> None:
    found = np.array([values(seed) for seed in range(first, first + runs)])
    inside = (np.abs(found[..., 0] - found[..., 2]) <= found[..., 1]).sum(axis=0)
    words = [
        f"{hits / runs:.3f} [{beta.ppf(0.025, hits, runs - hits + 1):.3f}] made {each[0, 2]:.4f} mean "
        f"{each[:, 0].mean():.4f} scatter {each[:, 0].std():.4f} U {each[:, 1].mean():.4f}"
        for hits, each in zip(inside, np.moveaxis(found, 1, 0), strict=True)
    ]
    assert (inside >= 0.93 * runs).all(), "\n".join(words)
    assert (found[..., 1] < 3.0 * NOISE).all()


def test_all_faces_that_the_section_cuts_count_unless_some_are_named() -> None:
    rows: list[dict[str, Any]] = [
        {"section": "front"},
        {"section": "front", "face": TOP},
        {"section": "front", "faces": [TOP, SIDE]},
    ]
    every, top, two = sheet(3, rows, lift=0.05).characteristics[:3]
    # The bottom and the other side of the outline were not scanned.
    assert "% of its outline has scan points" in every.remark
    assert every.outcome == "undecided"
    assert len(every.faces) == 4
    assert top.faces == (TOP,)
    assert top.outcome == "pass"
    assert top.coverage > 0.95
    assert two.value == pytest.approx(0.1, abs=two.uncertainty)
    assert two.position[1:] == pytest.approx((-0.4 * WIDTH, 0.5 * HEIGHT))


def test_a_section_that_is_not_of_this_part_is_named() -> None:
    end = next(face.number for face in part_faces(PART) if abs(face.centre[1]) > 1.0)
    rows: list[dict[str, Any]] = [
        {"section": "aside"},
        {"section": "front", "faces": [TOP, end]},
        {"section": "front", "face": TOP},
    ]
    aside, beside, top = sheet(3, rows).characteristics[:3]
    assert "misses the part" in aside.remark
    assert f"does not cut face {end}" in beside.remark
    assert top.measured


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"kind": "line-profile"}, r"section, the name of a \[\[section\]\], must be one of front, back"),
        ({"kind": "line-profile", "section": "frnt"}, "did you mean front"),
        ({"kind": "line-profile", "section": "front", "datum": "A"}, "under the alignment of the plan"),
        ({"kind": "line-profile", "section": "front", "at": [1, 2, 3]}, "at goes with roundness"),
        ({"kind": "profile", "face": 0, "section": "front"}, "section goes with line-profile, not with profile"),
        ({"kind": "profile of a line", "section": "front"}, 'kind = "line-profile"'),
    ],
)
def test_a_wrong_entry_is_named(row: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan_of({"section": SECTIONS, "characteristic": [{"tolerance": 0.1, **row}]})
