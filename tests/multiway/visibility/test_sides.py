"""Front and back of a thin sheet: what tells them apart, and what is said where nothing does."""

import dataclasses
from typing import Any

import numpy as np
import pytest

import dqreg
from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scan_names import NAMED_SCANS, named
from dqreg.multiway.scans.overlap import overlap_matrix
from dqreg.multiway.scans.scans import read_views, typical_size
from dqreg.multiway.visibility.sides import MAX_OPPOSITE_SHARE, Contradiction, Sides, viewpoints_of
from dqreg.synth.many_views import turntable_views
from dqreg.synth.parts import angle
from tests.multiway.edges_of_truth import registration

THICK = 0.02


def face(rng: np.random.Generator, height: float) -> np.ndarray:
    """Points of a sheet's side, with a fold so that a pose is fixed."""
    u, v = rng.uniform(0.0, 1.0, (2, 600))
    return np.column_stack([u, v, height + np.maximum(u - 0.5, 0.0)]) + 1e-3 * rng.normal(size=(600, 3))


@pytest.fixture(scope="module")
def sheet() -> list[PointCloud]:
    rng = np.random.default_rng(0)
    front = PointCloud(face(rng, 0.0), viewpoint=[0.0, 0.5, 3.0])
    return [
        front,
        PointCloud(face(rng, 0.0), viewpoint=[0.2, 0.4, 3.0]),
        PointCloud(face(rng, 0.0), viewpoint=[0, 0, -3.0]),
    ]


def edge(i: int, j: int) -> Edge:
    return Edge(i, j, registration(np.eye(4), 1e-6 * np.eye(6), np.zeros(3)))


def test_a_pair_that_lays_one_side_on_the_other_is_not_used(sheet: list[PointCloud]) -> None:
    sides = Sides.of(read_views(sheet, 0), "any")
    codes = [each.code for each in sides.checked([edge(0, 1), edge(0, 2), edge(1, 2)])]
    assert codes == ["unconfirmed", "opposite_sides", "opposite_sides"]


def test_sides_a_sheet_apart_are_no_contradiction(sheet: list[PointCloud]) -> None:
    views = read_views(sheet, 0)
    T = np.tile(np.eye(4), (3, 1, 1))
    overlap = np.ones((3, 3))
    found = list(Sides.of(views, "any").contradictions(T, overlap))
    assert Contradiction("opposite_sides", 0, 2) in found
    T[2, 2, 3] = -THICK
    assert not list(Sides.of(views, "any").contradictions(T, overlap))


def test_the_scanner_of_a_turntable_stands_on_one_side_of_all_scans() -> None:
    made = turntable_views(angle(), 12, pixels=50, rng=np.random.default_rng(0))
    views = read_views(list(made.scans), 0)
    viewpoints = viewpoints_of(views, "turntable")
    assert all(viewpoint is not None and not viewpoint.certain for viewpoint in viewpoints)
    # Of the normals, nine tenths have the sign that the true viewpoint gives, or nine tenths the opposite one.
    same = []
    for view, viewpoint, place in zip(views, viewpoints, made.viewpoints, strict=True):
        ways = [
            np.einsum("ij,ij->i", where - view.scan.points, view.scan.normals)
            for where in (viewpoint.place, place - view.origin)
        ]
        same.append(float(np.mean(ways[0] * ways[1] > 0.0)))
    assert min(same) > 0.9 or max(same) < 0.1


def test_a_line_of_sight_that_is_off_contradicts_no_true_poses() -> None:
    made = turntable_views(angle(), 24, pixels=50, noise=3e-4, rng=np.random.default_rng(23514))
    views = read_views(list(made.scans), 0)
    sides, overlap = Sides.of(views, "turntable"), overlap_matrix(views, made.T_world_scan, typical_size(views))
    assert not list(sides.contradictions(made.T_world_scan, overlap))
    # What one scan saw from the other side is told all the same.
    body = sides.bodies[0]
    assert body is not None
    assert body.scan is not None
    turned = dataclasses.replace(body, scan=dataclasses.replace(body.scan, normals=-body.scan.normals))
    T = np.linalg.inv(made.T_world_scan[1]) @ made.T_world_scan[0]
    assert sides.opposed(1, 0, T) < MAX_OPPOSITE_SHARE
    assert dataclasses.replace(sides, bodies=(turned, *sides.bodies[1:])).opposed(1, 0, T) > 0.9


def test_scans_that_nothing_is_known_of_have_no_side() -> None:
    rng = np.random.default_rng(1)
    ball = rng.normal(size=(3000, 3))
    ball /= np.linalg.norm(ball, axis=1, keepdims=True)
    views = read_views([ball, ball[::-1] + 1.0], 0)
    assert viewpoints_of(views, "turntable") == (None, None)
    assert list(Sides.of(views, "any").contradictions(np.tile(np.eye(4), (2, 1, 1)), np.ones((2, 2)))) == []


def test_a_sentence_of_many_scans_names_some_or_says_all(sheet: list[PointCloud]) -> None:
    views = read_views([PointCloud(sheet[0].points + shift) for shift in range(NAMED_SCANS + 2)], 0)
    assert named(views, range(len(views))) == f"all {len(views)} scans"
    assert named(views, range(len(views) - 1)).endswith(" and 1 more")


@pytest.mark.parametrize("viewpoints", ["here", np.zeros((3, 3)), [0.0, np.nan, 0.0], 3.0])
def test_a_bad_viewpoint_is_named(viewpoints: Any, sheet: list[PointCloud]) -> None:
    with pytest.raises(InputError, match="viewpoints"):
        dqreg.register_many(sheet[:2], viewpoints=viewpoints)
