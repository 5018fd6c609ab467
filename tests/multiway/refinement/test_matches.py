"""Matches of the joint refinement that are kept from round to round."""

import numpy as np

from dqreg.multiway.refinement.bodies import Body
from dqreg.multiway.refinement.matches import Matching
from dqreg.multiway.scans.scans import View, read_views
from dqreg.rigid import pose


def body(view: View) -> Body:
    return Body(view.scan, view.surface, view.origin)


def test_matches_kept_from_a_pose_near_by_are_those_of_a_new_search() -> None:
    rng = np.random.default_rng(2)
    u, v = rng.uniform(0.0, 1.0, (2, 1500))
    sheet = np.column_stack([u, v, 0.2 * np.sin(3.0 * u) * v])
    target, source = (body(view) for view in read_views([sheet[:800], sheet[700:]], 0))
    shift = pose.from_parts(np.eye(3), source.origin - target.origin)
    rows = source.rows(10**6)
    kept = Matching(source, target, rows)
    for step in (0.0, 1e-4, 1e-3, 0.02, 0.1):
        T = pose.exp(step * rng.normal(size=6)) @ shift
        old, new = kept.at(T, 0.1, 0.5), Matching(source, target, rows).at(T, 0.1, 0.5)
        np.testing.assert_array_equal(old.feet, new.feet)
        np.testing.assert_array_equal(old.aside, new.aside)
