"""What the page of ten tasks says: the tasks are ten, short, and their answers are right."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from dqreg.rigid import DualQuaternion, lines, pose

PAGE = (Path(__file__).parents[2] / "docs" / "howto_poses.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.S | re.M)


@pytest.fixture(scope="module")
def names():
    found: dict[str, object] = {"print": lambda *_: None}
    for block in BLOCKS:
        exec(compile(block, "howto_poses.md", "exec"), found)
    return found


def test_ten_tasks_of_three_or_four_lines():
    assert re.findall(r"^\*\*(\d+)\.", PAGE, flags=re.M) == [str(n) for n in range(1, 11)]
    assert len(BLOCKS) == 11
    assert max(len(block.splitlines()) for block in BLOCKS[1:]) <= 4


def test_the_answers_are_right(names):
    # Thirty poses with a spread of 0.05: their mean is good to 0.01; five sigmas.
    T = names["T"]
    for found in (names["mean"], names["fused"]):
        increment = pose.log(found.T_target_source @ pose.inverse(T))
        assert np.abs(increment).max() < 0.05
    screw = names["screw"]
    np.testing.assert_allclose(DualQuaternion.from_screw(*screw).as_matrix(), T, atol=1e-12)
    np.testing.assert_allclose(pose.move_lines(T, names["axis"]), names["axis"], atol=1e-12)
    assert names["steps"].shape == (100,)
    assert (np.rad2deg(names["angle"].real), names["angle"].dual) == pytest.approx((45.0, 2.0))
    np.testing.assert_allclose(lines.dual_angle(names["second"], names["second"]).dual, 0, atol=1e-15)
    # Weights of maximum likelihood: the covariance that the fit says is the bound, up to the noise of its own points.
    np.testing.assert_allclose(names["fit"].covariance, names["bound"], rtol=0.1, atol=1e-7)
    np.testing.assert_allclose(names["solvers"].hand_eye(names["A"], names["B"]).X, names["X"], atol=1e-9)
    np.testing.assert_allclose(names["path"].velocities(1.3), [0.2, 0.0, 0.4, 1.0, 0.0, 0.1], atol=1e-12)
