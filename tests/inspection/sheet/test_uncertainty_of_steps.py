"""Steps that lock motions: what was not known of these before stays so, and poses are within what is told of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection import Deviations, inspect, measure_deviations
from dqreg.inspection.plan.file import plan_of
from dqreg.inspection.sheet.aligned_part import aligned_part
from dqreg.rigid import pose, twist
from dqreg.synth.parts import box

PART, NOISE = Mesh(*box((30.0, 20.0, 10.0))), 0.03
SURFACE = MeshSurface(PART)
TOP = int(faces_of(PART)[1][int(np.argmax(PART.face_normals[:, 2]))])
FIRST = {"name": "all faces", "kind": "best-fit"}
POINTS = [[5, 5, 5], [-5, 5, 5], [0, -5, 5]]
LATER: dict[str, Any] = {
    "best-fit": {"name": "top", "kind": "best-fit", "faces": [TOP], "dof": "tz"},
    "minimax": {"name": "top", "kind": "minimax", "faces": [TOP], "dof": "tz"},
    "points": {"name": "top", "kind": "points", "points": POINTS, "dof": "tz"},
    "datums": {"name": "top", "kind": "datums", "dof": "tz"},
}
DATUM = [{"name": "A", "face": TOP}]


def scanned(seed: int, count: int = 1_500) -> Deviations:
    cloud, rng = sample_mesh(PART, count, np.random.default_rng(seed)), np.random.default_rng(seed + 1_000)
    return measure_deviations(cloud.points + rng.normal(0.0, NOISE, cloud.points.shape), PART, SURFACE, reach=2.0)


def planned(*steps: dict[str, Any]) -> Any:
    datums = {"datum": DATUM} if any(step["kind"] == "datums" for step in steps) else {}
    return plan_of({"tolerance": 1.0, "alignment": list(steps), **datums})


@pytest.mark.parametrize("kind", LATER)
def test_a_step_along_one_axis_leaves_what_is_not_known_of_the_others(kind: str) -> None:
    scan = scanned(63_080)
    first, both = (aligned_part(scan, planned(*steps)) for steps in ((FIRST,), (FIRST, LATER[kind])))
    own = both.steps[1].alignment
    # About the middle of the top, where the step holds the height, whichever way the part was turned before.
    at = both.part.on(both.part.faces[TOP]).mean(axis=0) if kind != "points" else np.mean(POINTS, axis=0)
    before, after, alone = (
        _about(covariance, centre, at)
        for covariance, centre in (
            (first.frame.covariance, first.frame.centre),
            (both.frame.covariance, both.frame.centre),
            (own.covariance, own.centre),
        )
    )
    expected = before.copy()
    expected[5], expected[:, 5] = 0.0, 0.0
    scale = np.outer(*[np.sqrt(np.diag(before))] * 2)
    np.testing.assert_allclose((after - alone) / scale, expected / scale, atol=0.05)
    laid = inspect(scan, planned(FIRST, LATER[kind])).deviations
    assert laid is not None
    np.testing.assert_allclose(laid.covariance, both.frame.covariance)


def _about(covariance: FloatArray, centre: FloatArray, at: FloatArray) -> FloatArray:
    move = twist.adjoint(pose.from_parts(np.eye(3), centre - at))
    return np.asarray(move @ covariance @ move.T)


@pytest.mark.parametrize("runs", [16, pytest.param(200, marks=pytest.mark.soak)])
@pytest.mark.parametrize("kind", ["best-fit", "points"])
def test_poses_after_two_steps_are_within_their_covariance(kind: str, runs: int) -> None:
    squares = []
    for seed in range(63_100, 63_100 + runs):
        found = aligned_part(scanned(seed, 6_000), planned(FIRST, LATER[kind]))
        error = twist.log(pose.about(found.steps[-1].T_target_source, -found.frame.centre))
        squares.append(error @ np.linalg.solve(found.frame.covariance, error))
    # Chi-square of six degrees of freedom: means of as many runs, within four of their standard deviations.
    assert abs(np.mean(squares) - 6.0) < 4.0 * np.sqrt(12.0 / runs)
