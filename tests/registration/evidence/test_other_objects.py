"""Faces of other objects that touch a placed part are told by where they go on."""

from __future__ import annotations

import numpy as np

from dqreg import Mesh
from dqreg.registration.evidence.other_objects import on_others
from dqreg.registration.problem.derived_values import Derived
from dqreg.rigid import pose
from dqreg.synth.parts import box
from tests.registration.scenes import problem_of


def test_a_strip_of_a_face_that_goes_on_off_the_part_is_of_another_object() -> None:
    # The top of a block, and a leaning board that touches it along one edge.
    part, rng = Mesh(*box((60.0, 40.0, 20.0))), np.random.default_rng(0)
    low, high = part.bounds
    top = np.column_stack([rng.uniform(low[:2], high[:2], (2_000, 2)), np.full(2_000, high[2])])
    along, up = rng.uniform(low[0], high[0], 1_000), rng.uniform(0.0, 40.0, 1_000)
    board = np.column_stack([along, high[1] + 0.7 * up, high[2] + 0.7 * up])
    points = np.concatenate([top, board])
    problem = problem_of(points, part, np.eye(4))
    prepared, T = problem.prepare(), problem.to_centred(np.eye(4))
    scan = pose.apply(pose.inverse(T), points - problem.target.origin)
    here, away = T, pose.from_parts(np.eye(3), np.array([0.0, 0.0, 200.0])) @ T
    found = on_others(prepared, Derived(), here[None], scan)
    # Points at edges are of no face, and may be of the part.
    assert np.mean(found[: len(top)]) < 0.03
    assert np.mean(found[len(top) :]) > 0.8
    # What lies on the part at one of two poses is none of another object.
    np.testing.assert_array_equal(on_others(prepared, Derived(), np.stack([away, here]), scan), found)
    assert np.mean(on_others(prepared, Derived(), away[None], scan)) > 0.8
