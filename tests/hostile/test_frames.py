from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh
from dqreg.registration.register import register
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.synth import disturbance
from tests.hostile.scenes import PART, SIZE, START
from tests.icp.scenes import bracket_points

# The same task in metres, and on a national grid, gives the same pose to this share of the part's size, and angle.
SAME = 1e-9
GRID = pose.from_parts(np.eye(3), [5e5, 4.4e6, 100.0])
SCAN = bracket_points(40, seed=0)
# The search needs a part that is far from alike in other poses, and a scan that shows it.
SEEN = bracket_points(60, seed=2)
TASKS: dict[str, tuple[FloatArray, dict[str, Any]]] = {
    "auto": (SCAN, {"method": "auto"}),
    "dq": (SCAN, {"method": "dq"}),
    "plane": (SCAN, {"method": "plane"}),
    "dof rz tx ty": (SCAN, {"dof": "rz tx ty"}),
    "dof tx": (SCAN, {"dof": "tx", "method": "dq"}),
    "from nothing": (SEEN, {"start": None}),
}


def run(name: str, scale: float = 1.0, shift: FloatArray | None = None) -> Registration:
    scan, options = TASKS[name]
    options = {"start": START, "effort": "fast", **options}
    shift = np.eye(4) if shift is None else shift
    if options["start"] is not None:
        start = pose.from_parts(START[:3, :3], scale * START[:3, 3])
        # Locked motions are about the origin, so the shifted task begins without a turn where some are.
        options["start"] = shift @ start @ pose.inverse(shift)
    return register(
        pose.apply(shift, scale * scan), Mesh(pose.apply(shift, scale * PART.vertices), PART.faces), **options
    )


def assert_same(T: FloatArray, one: FloatArray) -> None:
    gaps = np.linalg.norm(pose.apply(T, PART.vertices) - pose.apply(one, PART.vertices), axis=1)
    assert gaps.max() <= SAME * SIZE
    assert pose.angle_between(T, one) <= SAME


@pytest.mark.parametrize("name", TASKS)
def test_a_task_in_metres_is_the_task_in_millimetres(name: str) -> None:
    one, small = run(name), run(name, scale=1e-3)
    T = small.T_target_source.copy()
    T[:3, 3] *= 1e3
    assert_same(T, one.T_target_source)
    assert small.verdict.level == one.verdict.level
    assert [len(small.history), small.status] == [len(one.history), one.status]


@pytest.mark.parametrize("name", sorted(TASKS.keys() - {"dof rz tx ty"}))
def test_a_task_on_a_national_grid_is_the_task_at_home(name: str) -> None:
    # Coordinates of 4.4e6 are rounded to 5e-10, that is 6e-12 of the size.
    one, far = run(name), run(name, shift=GRID)
    assert_same(pose.inverse(GRID) @ far.T_target_source @ GRID, one.T_target_source)
    assert far.verdict.level == one.verdict.level


def test_locked_motions_are_about_the_frame_that_was_named_wherever_it_is() -> None:
    from dqreg.solvers import Freedom

    start = disturbance(np.random.default_rng(5), 0.0, 0.02 * SIZE, np.zeros(3))
    one = register(SCAN, PART, start, dof="rz tx ty", effort="fast")
    far = register(
        pose.apply(GRID, SCAN),
        Mesh(pose.apply(GRID, PART.vertices), PART.faces),
        GRID @ start @ pose.inverse(GRID),
        dof=Freedom.only("rz", "tx", "ty", frame=GRID),
        effort="fast",
    )
    assert_same(pose.inverse(GRID) @ far.T_target_source @ GRID, one.T_target_source)
