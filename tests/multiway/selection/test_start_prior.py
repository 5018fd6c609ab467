import dataclasses

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.selection.edge_selection import select_edges
from dqreg.multiway.selection.start_prior import joined_by_starts
from dqreg.rigid import pose
from dqreg.trust.records import Code, Reason, Verdict
from tests.multiway.edges_of_truth import registration, world

COUNT, SIGMA, SIZE = 8, 1e-3, 2.0


def ring(T: FloatArray, rng: np.random.Generator, code: Code = "unconstrained") -> list[Edge]:
    """Neighbours; every other pair is accepted, and the others slide along an edge."""
    edges = []
    for i in range(COUNT):
        j, along = (i + 1) % COUNT, np.r_[np.zeros(3), rng.normal(size=3)]
        along /= np.linalg.norm(along)
        loose = float(i % 2)
        error = SIGMA * rng.normal(size=6) + loose * 0.02 * rng.normal() * along
        measured = pose.exp(error) @ pose.inverse(T[i]) @ T[j]
        covariance = SIGMA**2 * np.eye(6) + loose * 0.05**2 * np.outer(along, along)
        result = registration(measured, covariance, np.zeros(3), "suspect" if loose else "accepted")
        if loose:
            result = dataclasses.replace(result, verdict=Verdict("suspect", (Reason("made by hand", code),)))
        edges.append(Edge(i, j, result))
    return edges


def test_starts_hold_what_pairs_leave_free_and_always_with_a_doubt() -> None:
    rng, T = np.random.default_rng(0), world(COUNT, 0)
    starts = {k: pose.exp(0.01 * rng.normal(size=6)) @ T[k] for k in range(COUNT)} | {0: T[0]}
    edges = ring(T, rng)
    alone = select_edges(edges, COUNT, 0, SIZE, 0.0, starts)
    assert np.isnan(alone.T_world_scan[2:COUNT]).all()
    prior = joined_by_starts(alone, starts, SIZE, 0.0)
    assert prior is not None
    found = select_edges(edges, COUNT, 0, SIZE, 0.0, starts, prior)
    off = np.linalg.norm((found.T_world_scan[:COUNT] - T)[:, :3, 3], axis=1)
    # As the starts err, where nothing else is known.
    assert off.max() < 0.1
    assert [doubt.code for doubt in prior.doubts()] == ["unconfirmed_scan"]


def test_pairs_far_from_starts_or_doubted_otherwise_join_nothing() -> None:
    rng, T = np.random.default_rng(1), world(COUNT, 1)
    far = {k: T[k] @ pose.exp(np.r_[0.0, 0.0, 0.5 * k, 0.0, 0.0, 0.0]) for k in range(COUNT)}
    for starts, edges in ((far, ring(T, rng)), (dict(enumerate(T)), ring(T, rng, "deviating_patches"))):
        prior = joined_by_starts(select_edges(edges, COUNT, 0, SIZE, 0.0, starts), starts, SIZE, 0.0)
        found = select_edges(edges, COUNT, 0, SIZE, 0.0, starts, prior)
        assert np.isnan(found.T_world_scan[2:COUNT]).all()
