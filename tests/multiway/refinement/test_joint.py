"""The joint refinement: what small faces alone hold is found from afar."""

import numpy as np
import pytest

from dqreg.multiway.refinement import joint
from dqreg.multiway.scans.scans import read_views
from dqreg.multiway.visibility.sides import body_of
from dqreg.rigid import pose

NOISE, WIDE, POST = 1e-4, 1500, 40


def floor_and_post(rng: np.random.Generator) -> np.ndarray:
    """Points of a wide floor, and of two walls of a small post on it, which alone hold the motions along the floor."""
    floor = np.column_stack([rng.uniform(0.0, 1.0, (WIDE, 2)), np.zeros(WIDE)])
    along, up = rng.uniform(0.0, 0.12, (2, POST))
    walls = [
        np.column_stack([np.full(POST, 0.5), 0.5 + along, up]),
        np.column_stack([0.5 + along, np.full(POST, 0.5), up]),
    ]
    return np.concatenate([floor, *walls]) + NOISE * rng.normal(size=(WIDE + 2 * POST, 3))


@pytest.mark.parametrize("soft", [joint.FIRST_SCALE_SPACINGS, 0.0])
def test_small_faces_count_though_they_begin_far_off(soft: float, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    views = read_views([floor_and_post(rng), floor_and_post(rng)], 0)
    bodies = [body_of(view, None) for view in views]
    truth = np.stack([pose.from_parts(np.eye(3), view.origin) for view in views])
    begun = truth.copy()
    # Nearly the spacing of the points, and a hundred times their noise.
    begun[1, :2, 3] += 0.01
    monkeypatch.setattr(joint, "FIRST_SCALE_SPACINGS", soft)
    found = joint.refine_jointly(bodies, begun, [(0, 1)], np.array([1]), 5000)
    far = np.linalg.norm((found.T_world_body[1] - truth[1])[:2, 3])
    assert found.converged
    spacing = views[0].scan.spacing
    assert far < 0.1 * spacing if soft > 0.0 else far > spacing
