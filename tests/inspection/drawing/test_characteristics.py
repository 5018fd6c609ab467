"""Form of faces with few points, by lobes that are known: the shape that is fitted takes some of them."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.inspection import inspect, measure_deviations
from dqreg.inspection.drawing.characteristics import form
from dqreg.inspection.features import fit_feature
from dqreg.inspection.plan.file import plan_of
from dqreg.synth.parts import bracket

ZONE, NOISE, RADIUS = 0.1, 0.003, 8.0


@pytest.mark.parametrize("lobes", [2, 3])
@pytest.mark.parametrize(("count", "heights"), [(10, [5.0]), (16, [5.0]), (16, [2.0, 8.0])])
def test_lobes_of_few_points_are_not_passed(count: int, heights: list[float], lobes: int) -> None:
    # Two lobes at one height are an axis that is tilted, as well: then the value is too small by more than is known.
    for seed in range(20_000, 20_010):
        rng = np.random.default_rng(seed)
        around = np.linspace(0.0, 2.0 * np.pi, count // len(heights), endpoint=False) + rng.uniform(0.0, 2.0 * np.pi)
        turn, z = (each.ravel() for each in np.meshgrid(around, heights))
        radii = RADIUS + 0.5 * ZONE * np.cos(lobes * turn)
        points = np.column_stack([radii * np.cos(turn), radii * np.sin(turn), z + rng.normal(0.0, 0.3, count)])
        points += rng.normal(0.0, NOISE, points.shape)
        found = form(fit_feature(points, "cylinder"), points, NOISE)
        assert found.decide(-np.inf, 0.5 * ZONE) != "pass"
        if lobes == 3:
            assert abs(found.value - ZONE) <= found.uncertainty + NOISE


@pytest.mark.parametrize("count", [8, 16])
def test_lobes_that_a_tilted_axis_follows_are_not_passed(count: int) -> None:
    # Points of a hole at one height lie on a tilted cylinder as well as on two lobes; its axis on the part tells.
    part = Mesh(*bracket())
    surface, middle = MeshSurface(part), np.array([46.5, 20.0, 5.0])
    plan = plan_of({"characteristic": [{"name": "hole", "kind": "form", "near": [54.5, 20, 5], "tolerance": 0.05}]})
    for seed in range(20_960, 20_966):
        rng = np.random.default_rng(seed)
        others = sample_mesh(part, 500, rng).points
        others = others[np.linalg.norm((others - middle)[:, :2], axis=1) > RADIUS + 1.0]
        turn = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False) + rng.uniform(0.0, 2.0 * np.pi)
        radii = RADIUS + 0.5 * ZONE * np.cos(2 * turn)
        hole = middle + np.column_stack([radii * np.cos(turn), radii * np.sin(turn), np.zeros(count)])
        points = np.concatenate([others, hole])
        points += rng.normal(0.0, NOISE, points.shape)
        (found,) = inspect(measure_deviations(points, part, surface, reach=1.0), plan).characteristics
        assert found.outcome == "undecided"
        assert found.remark or abs(found.value - ZONE) <= found.uncertainty
