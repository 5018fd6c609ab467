from itertools import combinations

import numpy as np

from dqreg.multiway.pose_graph import dual_poses
from dqreg.multiway.pose_graph.edges import graph_of, with_lower_targets
from dqreg.multiway.pose_graph.graph import normal_matrix, solve_graph
from dqreg.rigid import pose
from tests.multiway.edges_of_truth import edges_of, world


def test_dual_quaternions_of_many_poses_are_the_poses() -> None:
    rng = np.random.default_rng(0)
    A, B = pose.random(rng, reach=3.0, shape=(50,)), pose.random(rng, reach=3.0, shape=(50,))
    a, b = dual_poses.from_matrices(A), dual_poses.from_matrices(B)
    np.testing.assert_allclose(dual_poses.to_matrices(dual_poses.multiply(a, b)), A @ B, atol=1e-13)
    np.testing.assert_allclose(dual_poses.to_matrices(dual_poses.inverse(a)), pose.inverse(A), atol=1e-13)
    np.testing.assert_allclose(dual_poses.log(a), pose.log(A), atol=1e-11)
    np.testing.assert_allclose(dual_poses.to_matrices(dual_poses.exp(pose.log(A))), A, atol=1e-12)


def test_jacobians_are_the_differences_of_the_errors() -> None:
    T = world(6, seed=1)
    graph = graph_of(edges_of(T, combinations(range(6), 2), 1e-9, seed=2), 6)
    nodes = np.concatenate([T, np.eye(4)[None]])
    step, before, B = 1e-6 * np.arange(1.0, 7.0), graph.errors(nodes), graph.jacobians(nodes)
    for row in range(len(graph.targets)):
        moved = nodes.copy()
        moved[graph.sources[row]] = pose.exp(step) @ moved[graph.sources[row]]
        np.testing.assert_allclose(graph.errors(moved)[row] - before[row], B[row] @ step, atol=1e-9)


def test_exact_edges_give_the_exact_poses_from_far_starts() -> None:
    T = world(30, seed=3)
    pairs = [(k, (k + d) % 30) for k in range(30) for d in (1, 5)]
    graph = graph_of(edges_of(T, pairs, 1e-12, seed=4), 30)
    nodes = np.concatenate([T, np.eye(4)[None]])
    start = pose.exp(0.2 * np.random.default_rng(5).normal(size=(31, 6))) @ nodes
    start[0] = nodes[0]
    found = solve_graph(graph, start, np.arange(1, 30))
    np.testing.assert_allclose(found[:30], T, atol=1e-9)


def test_the_normal_matrix_predicts_the_errors_of_the_poses() -> None:
    """NEES of the poses, 6 each: 80 chi-squares of 6, five standard errors of whose mean are 1.9."""
    count, pairs = 5, list(combinations(range(5), 2))
    T = np.concatenate([world(count, seed=6), np.eye(4)[None]])
    nees = []
    for seed in range(20):
        graph = graph_of(edges_of(T[:count], pairs, 1e-3, seed=100 + seed), count)
        found = solve_graph(graph, T, np.arange(1, count))
        errors = pose.log(T[1:count] @ pose.inverse(found[1:count])).ravel()
        matrix = normal_matrix(graph, graph.blocks(found))[6:30][:, 6:30]
        nees.append(errors @ (matrix @ errors) / (count - 1))
    assert abs(np.mean(nees) - 6.0) < 1.9


def test_an_edge_turned_round_has_the_same_chi_square() -> None:
    T = world(5, seed=7)
    edges = edges_of(T, [(j, i) for i, j in combinations(range(5), 2)], 1e-3, seed=8)
    graph = graph_of(edges, 5)
    nodes = np.concatenate([T, np.eye(4)[None]])
    back = with_lower_targets(graph)
    assert (back.targets < back.sources).all()
    np.testing.assert_allclose(back.chi2(nodes), graph.chi2(nodes), rtol=1e-6)
