"""A scan of something else among right ones: free space tells which it is, and the others stay where they were."""

import dataclasses

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import PointCloud
from dqreg.multiway.pose_graph.edges import Edge
from dqreg.multiway.scans.scans import View, read_views, typical_size
from dqreg.multiway.selection.outlier_scans import Judge, without_contradicting_scans
from dqreg.multiway.visibility.sides import Sides, viewpoints_of
from dqreg.multiway.visibility.viewpoints import Viewpoints
from dqreg.rigid import pose
from dqreg.synth.many_views import turntable_views
from dqreg.synth.parts import bracket, feeder
from tests.multiway.edges_of_truth import registration

VIEWS, NOISE = 8, 1e-3


@dataclasses.dataclass(frozen=True)
class Turned:
    """Views of a bracket, then one of a feeder; poses of the former."""

    scans: list[FloatArray]
    T: FloatArray
    viewpoints: FloatArray
    size: float


@pytest.fixture(scope="module")
def turned() -> Turned:
    made = turntable_views(bracket(), VIEWS, pixels=45, rng=np.random.default_rng(0))
    vertices, faces = feeder()
    scale = np.linalg.norm(np.ptp(bracket()[0], axis=0)) / np.linalg.norm(np.ptp(vertices, axis=0))
    other = turntable_views((scale * vertices, faces), 2, pixels=45, rng=np.random.default_rng(1))
    size = float(np.linalg.norm(np.ptp(made.scans[0], axis=0)))
    viewpoints = np.concatenate([made.viewpoints, other.viewpoints[:1]])
    return Turned([*made.scans, other.scans[0]], made.T_world_scan, viewpoints, size)


def edge(i: int, j: int, T: FloatArray, size: float) -> Edge:
    sigma = NOISE * np.r_[[1.0] * 3, [size] * 3]
    return Edge(i, j, registration(T, np.diag(sigma**2), np.zeros(3)))


def edges_among(turned: Turned) -> list[Edge]:
    """Right edges to the next two views."""
    ring = [(k, (k + step) % VIEWS) for k in range(VIEWS) for step in (1, 2)]
    return [edge(i, j, pose.inverse(turned.T[i]) @ turned.T[j], turned.size) for i, j in ring]


def judge_of(views: tuple[View, ...], edges: list[Edge]) -> Judge:
    size = typical_size(views)
    return Judge(Sides.of(views, "any", edges), len(views), 0, size, 1e-3 * size, {})


def views_of(turned: Turned, *, known: bool) -> tuple[View, ...]:
    places = turned.viewpoints if known else [None] * len(turned.scans)
    return read_views([PointCloud(p, viewpoint=v) for p, v in zip(turned.scans, places, strict=True)], 0)


def test_a_scan_that_agrees_with_its_neighbours_alone_is_left_out(turned: Turned) -> None:
    views = views_of(turned, known=True)
    # The middle of the feeder on that of the bracket: its edges to three neighbours agree with each other.
    middle = [pose.apply(turned.T[k], turned.scans[k]).mean(axis=0) for k in range(3)]
    T_feeder = pose.from_parts(np.eye(3), np.mean(middle, axis=0) - turned.scans[-1].mean(axis=0))
    right = edges_among(turned)
    wrong = [edge(k, VIEWS, pose.inverse(turned.T[k]) @ T_feeder, turned.size) for k in range(3)]
    judge = judge_of(views, right)
    # Free space between the two of a pair would refute such edges one by one.
    alone = dataclasses.replace(judge, sides=dataclasses.replace(judge.sides, known=dict.fromkeys(keys_of(wrong))))
    selection = alone(right + wrong)
    assert np.isfinite(selection.T_world_scan[VIEWS]).all()
    _, found = without_contradicting_scans(alone, selection)
    assert np.isnan(found.T_world_scan[VIEWS]).all()
    assert {e.code for e in found.edges if e.source == VIEWS} == {"looked_through"}
    assert all(e.used for e in found.edges if e.source != VIEWS)


def keys_of(edges: list[Edge]) -> list[tuple[int, int, bytes]]:
    return [(e.target, e.source, e.registration.T_target_source.tobytes()) for e in edges]


def test_right_scans_stay_where_they_were(turned: Turned) -> None:
    views = views_of(turned, known=True)[:VIEWS]
    right = edges_among(turned)
    judge = judge_of(views, right)
    before = judge(right)
    _, after = without_contradicting_scans(judge, before)
    np.testing.assert_array_equal(after.T_world_scan, before.T_world_scan)
    assert all(e.used for e in after.edges)


def test_a_line_of_sight_that_accepted_pairs_agree_with_is_one(turned: Turned) -> None:
    views, right = views_of(turned, known=False)[:VIEWS], edges_among(turned)
    viewpoints: Viewpoints = viewpoints_of(views, "any", right)
    for view, viewpoint, place in zip(views, viewpoints, turned.viewpoints, strict=False):
        assert viewpoint is not None
        assert viewpoint.certain
        towards, true = viewpoint.place - view.scan.points.mean(axis=0), place - view.origin
        # One in 150 directions is tried, and all that see the same faces serve as well.
        assert towards @ true > 0.7 * np.linalg.norm(towards) * np.linalg.norm(true)
    assert viewpoints_of(views, "any") == (None,) * VIEWS
