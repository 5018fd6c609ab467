"""What an edge says of its motions."""

import dataclasses

import numpy as np
import pytest

from dqreg.multiway.pose_graph.edges import information_of_edge
from dqreg.trust import information_of
from dqreg.trust.covariance import covariance_of, observe_directions, partial_information_of
from tests.multiway.edges_of_truth import registration
from tests.trust.shapes import cylinder


@pytest.mark.parametrize("kept", [True, False])
def test_nothing_is_known_along_free_motions_whose_axes_miss_the_centre(kept: bool) -> None:
    """Oracle: a round bar turns and slides in its bore, wherever the centre is; 4,000 points know the other motions."""
    points, normals = cylinder(np.random.default_rng(0), 4_000)
    centre, axis = np.array([0.7, -0.4, 0.2]), np.array([0.0, 0.0, 1.0])
    noise = 1e-3 * np.random.default_rng(1).normal(size=len(points))
    known = information_of(points, normals, noise, np.ones(len(points)), 1.5, centre)
    edge = registration(np.eye(4), covariance_of(known), centre)
    settings = {**edge.settings, "diagonal": 3.0}
    partial = partial_information_of(known) if kept else None
    directions = observe_directions(known)
    edge = dataclasses.replace(edge, observability=directions, partial_information=partial, settings=settings)
    found = information_of_edge(edge)
    turn, slide = np.r_[axis, np.cross(axis, centre)], np.r_[np.zeros(3), axis]
    across = np.r_[np.zeros(3), 1.0, 0.0, 0.0]
    for free in (turn, slide):
        assert free @ found @ free <= 1e-6 * (across @ found @ across)
    assert across @ found @ across == pytest.approx(0.5 * len(points) / 1e-3**2, rel=0.3)
