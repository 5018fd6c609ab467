"""Scans as they are read: viewpoints that cannot be right, and what is said of them."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import PointCloud
from dqreg.multiway.scans.scans import View, read_views
from dqreg.multiway.selection.edge_selection import select_edges
from dqreg.multiway.verdict import judge_scans
from dqreg.rigid import pose
from dqreg.synth.many_views import ManyViews, turntable_views
from dqreg.synth.parts import flange
from dqreg.trust.records import Code, Reason, Verdict
from tests.multiway.edges_of_truth import edges_of, world

COUNT = 4


@pytest.fixture(scope="module")
def made() -> ManyViews:
    return turntable_views(flange(), COUNT, pixels=60, rng=np.random.default_rng(3))


def beside(points: np.ndarray, place: np.ndarray) -> np.ndarray:
    """As far away, a quarter of a turn round."""
    middle = points.mean(axis=0)
    across = np.linalg.svd((place - middle)[None])[2][1]
    return np.asarray(middle + np.linalg.norm(place - middle) * across)


def test_where_the_scanner_stood_is_kept(made: ManyViews) -> None:
    assert [view.hidden for view in read_views(list(made.scans), 0, made.viewpoints)] == [0.0] * COUNT


def test_a_viewpoint_that_cannot_have_seen_the_scan_is_not_used(made: ManyViews) -> None:
    places = made.viewpoints.copy()
    places[1] = beside(made.scans[1], places[1])
    views = read_views(list(made.scans), 0, places)
    assert [view.hidden > 0.1 for view in views] == [False, True, False, False]
    assert [view.scan.oriented for view in views] == [True, False, True, True]


def test_where_most_viewpoints_are_wrong_none_is_used(made: ManyViews) -> None:
    places = np.array([beside(points, place) for points, place in zip(made.scans, made.viewpoints, strict=True)])
    places[0] = made.viewpoints[0]
    assert not any(view.scan.oriented for view in read_views(list(made.scans), 0, places))


def test_viewpoints_may_be_known_of_some_scans_alone(made: ManyViews) -> None:
    views = read_views(list(made.scans), 0, [None, *made.viewpoints[1:].tolist()])
    assert [view.scan.oriented for view in views] == [False, True, True, True]


def test_one_cloud_is_no_list_of_scans(made: ManyViews) -> None:
    for one in (made.scans[0], PointCloud(made.scans[0]), "scan.ply", iter(made.scans)):
        with pytest.raises(InputError, match="scans must be a list of paths, arrays or clouds"):
            read_views(one, 0)  # type: ignore[arg-type]


def test_many_unusable_scans_are_one_short_message() -> None:
    with pytest.raises(InputError, match=r"scan 2: .*; and 997 more") as error:
        read_views([np.zeros(3)] * 1000, 0)
    assert len(str(error.value)) < 600


def verdict_of(codes: list[Code], views: list[View]) -> Verdict:
    """The verdict on five scans in a ring whose pairs give these reasons."""
    T = world(5, 0)
    edges = edges_of(T, [(k, (k + step) % 5) for step in (1, 2) for k in range(5)], 1e-3, 0)
    edges = [
        dataclasses.replace(
            edge,
            registration=dataclasses.replace(
                edge.registration,
                verdict=Verdict("accepted" if code == "accepted" else "suspect", (Reason("made by hand", code),)),
            ),
        )
        for edge, code in zip(edges, codes, strict=True)
    ]
    selection = select_edges(edges, 5, 0, 2.0, 0.0, {})
    return judge_scans(
        views, selection, selection.T_world_scan[:5], np.zeros((5, 6, 6)), 2.0, converged=True, stopped=""
    )


def test_viewpoints_that_most_pairs_contradict_are_told() -> None:
    stood = [View(str(k), PointCloud(np.eye(3), viewpoint=[0.0, 0.0, 5.0])) for k in range(5)]
    unknown = [View(str(k), PointCloud(np.eye(3))) for k in range(5)]
    codes: list[Code] = ["accepted"] * 6 + ["looked_through"] * 4
    assert "wrong_viewpoint" in verdict_of(codes, stood).codes
    assert "wrong_viewpoint" not in verdict_of(codes, unknown).codes
    assert "wrong_viewpoint" not in verdict_of(codes[:6] + ["accepted"] * 3 + ["looked_through"], stood).codes
    # A viewpoint that is not used is a remark: the answer is the one without it.
    remark = verdict_of(["accepted"] * 10, [dataclasses.replace(stood[0], hidden=0.3), *unknown[1:]])
    assert remark.level == "accepted"
    assert "wrong_viewpoint" in remark.codes


def test_normals_of_the_merged_cloud_have_a_sign_or_are_not_there(made: ManyViews) -> None:
    from dqreg.multiway.scans.merge import merged

    seen, unseen = (read_views(list(made.scans), 0, places) for places in (made.viewpoints, None))
    assert merged(unseen, made.T_world_scan, None).normals is None
    cloud = merged(seen, made.T_world_scan, 0.0)
    assert cloud.normals is not None
    places = np.repeat(
        [pose.apply(T, p[None])[0] for T, p in zip(made.T_world_scan, made.viewpoints, strict=True)],
        [len(view.scan.points) for view in seen],
        axis=0,
    )
    # Each normal looks towards the scanner that saw its point.
    towards = np.einsum("ij,ij->i", cloud.normals, places - cloud.points)
    assert (towards > 0.0).mean() > 0.99


def test_an_empty_file_is_named_and_left_out_and_a_missing_one_refused(tmp_path: Path) -> None:
    cloud = np.random.default_rng(0).normal(size=(60, 3))
    empty = tmp_path / "empty.xyz"
    empty.touch()
    views = read_views([cloud, empty, cloud + 1.0], 0)
    assert [view.usable for view in views] == [True, False, True]
    assert "empty file" in views[1].problem
    with pytest.raises(InputError, match=r"missing\.ply"):
        read_views([cloud, tmp_path / "missing.ply", cloud + 1.0], 0)


def test_scans_may_be_given_by_name(made: ManyViews) -> None:
    named = dict(zip(("front", "left", "back", "right"), made.scans, strict=True))
    views = read_views(named, 0)
    assert [view.name for view in views] == list(named)
    assert [view.digest for view in views] == [view.digest for view in read_views(list(made.scans), 0)]
    with pytest.raises(InputError, match="two scans"):
        read_views({"front": made.scans[0]}, 0)
