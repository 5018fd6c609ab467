"""Roundness and straightness: the zone against brute force, values against faults that were made."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, get_args

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import beta

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import inspect, measure_deviations, part_faces
from dqreg.inspection.line_forms.worst import axis_form, width_of_zone
from dqreg.inspection.plan.characteristics import CharacteristicKind
from dqreg.inspection.plan.file import plan_of
from dqreg.report.definitions import DEFINITIONS
from dqreg.synth.parts import cylinder

RADIUS, HEIGHT, NOISE, SPACING = 8.0, 30.0, 0.01, 0.7
PIN = Mesh(*cylinder(diameter=2.0 * RADIUS, height=HEIGHT, segments=96))
WALL = next(face.number for face in part_faces(PIN) if face.kind == "cylinder")
TOP = next(face.number for face in part_faces(PIN) if face.kind == "plane" and face.centre[2] > 0.0)
LOBES, BOW, BENT = 0.05, 0.06, 0.04

Fault = Callable[[np.ndarray, np.ndarray], np.ndarray]


@cache
def surface() -> MeshSurface:
    return MeshSurface(PIN)


def sheet(seed: int, rows: list[dict[str, Any]], fault: Fault, bent: float = 0.0, share: float = 1.0) -> Any:
    """A plan carried out on a pin whose wall deviates by a function of turn and height, and whose axis bends."""
    rng = np.random.default_rng(seed)
    count = int(share * 2.0 * np.pi * RADIUS * HEIGHT / SPACING**2)
    turn, z = rng.uniform(0.0, share * 2.0 * np.pi, count), rng.uniform(-0.5 * HEIGHT, 0.5 * HEIGHT, count)
    r = RADIUS + fault(turn, z) + rng.normal(0.0, NOISE, count)
    wall = np.column_stack([r * np.cos(turn), r * np.sin(turn), z])
    wall[:, 0] += 0.5 * bent * np.cos(2.0 * np.pi * z / HEIGHT)
    turn, r = rng.uniform(0.0, 2.0 * np.pi, 400), RADIUS * np.sqrt(rng.uniform(0.0, 1.0, 400))
    top = np.column_stack([r * np.cos(turn), r * np.sin(turn), rng.normal(0.5 * HEIGHT, NOISE, 400)])
    found = measure_deviations(np.vstack([wall, top]), PIN, surface(), reach=2.0)
    return inspect(found, plan_of({"characteristic": rows}))


def lobed(turn: np.ndarray, z: np.ndarray) -> np.ndarray:
    # Three lobes at one end that fade towards the other: the worst section is at the end.
    return np.asarray(0.5 * LOBES * np.cos(3.0 * turn) * (0.5 + z / HEIGHT))


def waisted(turn: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * BOW * np.cos(2.0 * np.pi * z / HEIGHT))


def plain(turn: np.ndarray, z: np.ndarray) -> np.ndarray:
    return np.zeros_like(turn)


ROUND = {"name": "round", "kind": "roundness", "face": WALL, "tolerance": 0.1}
LOWER = {"name": "lower", "kind": "roundness", "face": WALL, "at": [0, 0, -0.35 * HEIGHT], "tolerance": 0.1}
LINE = {"name": "line", "kind": "straightness", "face": WALL, "tolerance": 0.1}
AXIS = {"name": "axis", "kind": "straightness", "of": "axis", "face": WALL, "tolerance": 0.1}
ACROSS = {"name": "top", "kind": "straightness", "face": TOP, "direction": [1, 1, 0], "tolerance": 0.1}


def values(seed: int, every: bool) -> list[tuple[float, float, float]]:
    """Measured, uncertainty and what was made."""
    # The last of five sections lies at nine tenths of the height.
    faults: list[tuple[list[dict[str, Any]], Fault, float, list[float]]] = [
        ([ROUND], lobed, 0.0, [0.9 * LOBES]),
        ([LINE], waisted, 0.0, [BOW]),
        ([LOWER], lobed, 0.0, [0.15 * LOBES]),
        ([AXIS], plain, BENT, [BENT]),
        ([ROUND], waisted, 0.0, [0.0]),
        ([ROUND, LINE, AXIS, ACROSS], plain, 0.0, [0.0] * 4),
    ]
    found = []
    for k, (rows, fault, bent, made) in enumerate(faults if every else faults[:2]):
        sheets = sheet(seed + 100_000 * k, rows, fault, bent).characteristics
        found += [(row.value, row.uncertainty, truth) for row, truth in zip(sheets, made, strict=True)]
    return found


@pytest.mark.parametrize(("first", "runs"), [(9_000, 1), pytest.param(12_000, 300, marks=pytest.mark.soak)])
def test_lobes_and_bows_are_within_their_stated_uncertainty(first: int, runs: int) -> None:
    found = np.array([values(seed, runs > 1) for seed in range(first, first + runs)])
    inside = (np.abs(found[..., 0] - found[..., 2]) <= found[..., 1]).sum(axis=0)
    words = [
        f"{hits / runs:.3f} [{beta.ppf(0.025, hits, runs - hits + 1):.3f}] made {each[0, 2]:.4f} mean "
        f"{each[:, 0].mean():.4f} scatter {each[:, 0].std():.4f} U {each[:, 1].mean():.4f}"
        for hits, each in zip(inside, np.moveaxis(found, 1, 0), strict=True)
    ]
    # k = 2 promises 95.4 %: of 300 runs fewer than 276 inside have a chance below 0.5 %.
    assert (inside >= (276 if runs == 300 else runs)).all(), "\n".join(words)
    # What was made is told from nothing.
    assert (found[:, :2, 0] > found[:, :2, 1]).all()


def test_the_label_stands_at_the_worst_section() -> None:
    (row,) = sheet(3, [ROUND], lobed).characteristics
    assert row.position == pytest.approx((0.0, 0.0, 0.4 * HEIGHT), abs=0.05 * HEIGHT)


@pytest.mark.parametrize("seed", range(4))
def test_no_search_finds_two_circles_that_are_closer(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = rng.uniform(0.0, 2.0 * np.pi * rng.uniform(0.6, 1.0), 60)
    away = 5.0 + rng.normal(0.0, 0.1, 60)
    points = away[:, None] * np.column_stack([np.cos(turn), np.sin(turn)]) + rng.normal(0.0, 0.2, 2)

    def width(centre: np.ndarray) -> float:
        return float(np.ptp(np.linalg.norm(points - centre, axis=1)))

    grid = min((width(np.array([x, y])), x, y) for x in np.linspace(-1, 1, 81) for y in np.linspace(-1, 1, 81))
    best = minimize(width, grid[1:], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12}).fun
    found = width_of_zone(np.linalg.norm(points, axis=1) - 5.0, np.arctan2(points[:, 1], points[:, 0]), 5.0)
    assert found <= best + 1e-9
    assert found == pytest.approx(best, abs=1e-4)


def test_no_two_parallel_lines_are_closer() -> None:
    rng = np.random.default_rng(5)
    x, y = rng.uniform(0.0, 10.0, 40), rng.normal(0.0, 0.1, 40)
    y += 0.05 * x
    widths = []
    for a in range(40):
        for b in range(a):
            normal = np.array([y[a] - y[b], x[b] - x[a]]) / np.hypot(x[a] - x[b], y[a] - y[b])
            widths.append(float(np.ptp(np.column_stack([x, y]) @ normal)))
    # One of two parallel lines passes through two points (Houle and Toussaint 1988).
    assert width_of_zone(y, x, 0.0) == pytest.approx(min(widths), rel=1e-9)


def test_an_axis_without_noise_is_as_straight_as_it_is() -> None:
    z = np.linspace(-1.0, 1.0, 9)
    centres = np.column_stack([0.1 * z + 0.02 * (z**2 - 0.5), -0.05 * z, 10.0 * z])
    # An arc of a parabola lies within half of its height, to each side of the middle.
    assert axis_form(centres, np.zeros((9, 2, 2))).value == pytest.approx(0.02, rel=1e-3)


def test_what_was_not_scanned_all_round_is_not_measured() -> None:
    found = sheet(1, [ROUND, LOWER, AXIS, LINE], plain, share=0.4)
    words = [row.remark for row in found.characteristics]
    assert "of 360 degrees, and more than half of them are needed" in words[0]
    assert f"the section at [0, 0, {-0.35 * HEIGHT:g}]" in words[1]
    assert words[2]
    assert not words[3]
    assert found.outcome == "undecided"


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ({"kind": "roundness", "face": TOP}, "a plane has no round section"),
        (
            {"kind": "roundness", "face": WALL, "at": [0, 0, 16]},
            r"at = \[0, 0, 16\] lies [01.]+[0-9]* beyond the end",
        ),
        ({"kind": "roundness", "face": WALL, "direction": [0, 0, 1]}, "direction is of spheres"),
        ({"kind": "straightness", "face": TOP}, r"give direction = \[x, y, z\]"),
        ({"kind": "straightness", "face": TOP, "direction": [0, 0, 1]}, "does not lie along the face"),
        ({"kind": "straightness", "face": WALL, "direction": [0, 0, 1]}, "direction is of planes"),
        ({"kind": "straightness", "face": WALL, "at": [0, 0, 1]}, "nearer to the axis than to the face"),
        ({"kind": "straightness", "of": "axis", "face": TOP}, "a plane has no axis"),
        ({"kind": "straightness", "of": "axes", "face": WALL}, "of must be one of surface, axis"),
        ({"kind": "roundness", "of": "axis", "face": WALL}, "of must be one of surface"),
        ({"kind": "straightness", "of": "axis", "at": [1, 2, 3], "face": WALL}, "at does not go with"),
        ({"kind": "form", "at": [1, 2, 3], "face": WALL}, "at goes with roundness, straightness, circular-runout"),
        ({"kind": "roundness", "at": [1, 2], "face": WALL}, "at must be three numbers"),
        ({"kind": "roundness", "at": [[1, 2, 3], [1, 2]], "face": WALL}, "at must be three numbers"),
        ({"kind": "straightness", "face": TOP, "direction": [0, 0, 0]}, "direction must not be of length zero"),
    ],
)
def test_a_wrong_line_is_named_with_its_entry(row: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=f"characteristic .*{words}"):
        sheet(2, [{"name": "it", "tolerance": 1, **row}], plain)


def test_a_ball_is_measured_on_the_sections_that_were_scanned() -> None:
    trimesh = pytest.importorskip("trimesh")
    solid = trimesh.creation.icosphere(subdivisions=3, radius=10.0)
    ball = Mesh(solid.vertices, solid.faces)
    rng = np.random.default_rng(0)
    points = rng.normal(size=(5_000, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    # The upper two thirds of a ball whose horizontal sections have four lobes.
    points = points[points[:, 2] > -0.3]
    turn, flat = np.arctan2(points[:, 1], points[:, 0]), np.hypot(points[:, 0], points[:, 1])
    r = 10.0 + 0.025 * np.cos(4.0 * turn) * flat**4 + rng.normal(0.0, 0.005, len(points))
    found = measure_deviations(points * r[:, None], ball, MeshSurface(ball), reach=1.0)
    rows = [{"kind": "roundness", "face": 0, "tolerance": 1, "direction": list(axis)} for axis in np.eye(3)[1:]]
    upright, level = inspect(found, plan_of({"characteristic": rows})).characteristics
    assert abs(level.value - 0.05) <= level.uncertainty < 0.02
    # An upright section shows the lobes at both sides only, with the place below open.
    assert upright.value < level.value
    with pytest.raises(InputError, match="give direction, its normal, in place of at"):
        inspect(found, plan_of({"characteristic": [{**rows[0], "at": [0, 0, 1]}]}))


def test_every_kind_is_defined_on_the_sheet() -> None:
    assert set(DEFINITIONS) == set(get_args(CharacteristicKind))
