from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.rigid import pose
from dqreg.search import PairTable
from dqreg.search.features import scan_features
from dqreg.search.pairs import LENGTH_BIN, MIN_PAIR_DIAGONALS, pair_hypotheses, pair_keys
from dqreg.search.poses import Poses
from dqreg.synth import random_pose
from dqreg.synth.parts import bracket, plate


@pytest.fixture(scope="module")
def part():
    return Mesh(*bracket())


@pytest.fixture(scope="module")
def surface(part):
    return MeshSurface(part)


@pytest.fixture(scope="module")
def table(part, surface):
    return PairTable.of(part, surface)


def lengths(table):
    points = table.points.points
    return np.linalg.norm(points[table.second] - points[table.first], axis=1)


def errors_of(poses, T, mesh):
    """Worst displacement of every 20th vertex under each of many poses."""
    corners = mesh.vertices[::20]
    at = pose.apply(pose.inverse(T), corners)
    return np.linalg.norm(poses.apply(at) - corners, axis=2).max(axis=1)


def keys_of(table):
    """Key of each pair."""
    return np.repeat(np.arange(len(table.starts) - 1), np.diff(table.starts))


def pairs_of(table, rows=slice(None)):
    return table.first[rows].astype(np.int64), table.second[rows].astype(np.int64)


def test_pairs_stand_at_their_keys(table):
    keys, usable = pair_keys(table.points, *pairs_of(table), table.size)
    np.testing.assert_array_equal(keys_of(table), keys)
    assert usable.all()
    assert lengths(table).min() > (MIN_PAIR_DIAGONALS - 1e-6) * table.size


def test_pairs_of_one_key_agree_to_a_bin_in_length(table):
    same = np.flatnonzero(np.diff(keys_of(table)) == 0)
    gap = np.abs(lengths(table)[same] - lengths(table)[same + 1])
    assert gap.max() <= (LENGTH_BIN + 1e-6) * table.size


def test_keys_do_not_know_pose_or_sign(table):
    rng = np.random.default_rng(0)
    places = table.points
    T = random_pose(rng, table.size, np.zeros(3))
    signs = rng.choice([-1.0, 1.0], size=(len(places.points), 1))
    moved = dataclasses.replace(
        places, points=pose.apply(T, places.points), directions=signs * pose.rotate(T, places.directions)
    )
    rows = rng.choice(len(table.first), size=5_000)
    keys, _ = pair_keys(moved, *pairs_of(table, rows), table.size)
    # Single precision moves a few over the border of a bin.
    assert (keys == keys_of(table)[rows]).mean() > 0.99


def test_no_pose_is_lost_where_normals_stand_at_right_angles_to_the_line():
    # A thin plate: nearly all pairs are of one face or of its rim. Truth: the drawn pose.
    mesh = Mesh(*plate())
    table = PairTable.of(mesh, MeshSurface(mesh))
    rng = np.random.default_rng(1)
    T = random_pose(rng, mesh.diagonal, mesh.centre)
    cloud = PointCloud(pose.apply(pose.inverse(T), sample_mesh(mesh, 8_000, rng).points))
    poses = pair_hypotheses(scan_features(prepare_scan(cloud), mesh.diagonal), table, rng)
    assert np.count_nonzero(errors_of(poses, T, mesh) < 0.1 * mesh.diagonal) >= 5


@pytest.mark.parametrize("given", [True, False])
@pytest.mark.parametrize("seed", [0, 1])
def test_a_hypothesis_is_near_the_truth(part, table, seed, given):
    # Truth: the drawn pose itself. The table's points stand 4 % of the size apart, so half of that is near.
    rng = np.random.default_rng(seed)
    T = random_pose(rng, part.diagonal, part.centre)
    sample = sample_mesh(part, 5_000, rng)
    back = pose.inverse(T)
    normals = None
    if given:
        # Signs are not to be relied on: half of them are wrong here.
        normals = pose.rotate(back, sample.normals) * rng.choice([-1.0, 1.0], size=(5_000, 1))
    scan = prepare_scan(PointCloud(pose.apply(back, sample.points), normals))
    poses = pair_hypotheses(scan_features(scan, part.diagonal), table, rng)
    assert errors_of(poses, T, part).min() < 0.1 * part.diagonal


def test_no_directions_no_hypotheses(table):
    line = np.column_stack([np.linspace(0, 50, 200), np.zeros(200), np.zeros(200)])
    places = scan_features(prepare_scan(PointCloud(line)), table.size)
    poses = pair_hypotheses(places, table, np.random.default_rng(0))
    assert poses.R.shape == (0, 3, 3)
    assert poses.t.shape == (0, 3)


def test_grid_scores_agree_with_exact_distances(part, surface, table):
    rng = np.random.default_rng(1)
    points = sample_mesh(part, 300, rng).points
    poses = np.array([pose.exp(rng.normal(size=6) * [0.1, 0.1, 0.1, 5, 5, 5]) for _ in range(20)])
    reach = 0.05 * part.diagonal
    got = table.grid.scores(Poses.of(poses), points, reach)
    exact = []
    for T in poses:
        d = surface.closest(pose.apply(T, points)).distances
        exact.append(np.maximum(1.0 - (d / reach) ** 2, 0.0).mean())
    # A point is at most half a cell's diagonal from its node; the gain's slope is at most 2 / reach.
    bound = 2.0 / reach * 0.5 * np.sqrt(3.0) * table.grid.cell
    assert np.abs(got - exact).max() < bound
    assert np.corrcoef(got, exact)[0, 1] > 0.99
