"""Scans tested against all others together: what is said there decides who stays."""

import dataclasses

import numpy as np
import pytest

from dqreg.geometry import PointCloud
from dqreg.multiway.pose_graph.edges import better, is_refused
from dqreg.multiway.scans.scans import View, read_views, typical_size
from dqreg.multiway.selection import outlier_scans
from dqreg.multiway.selection.outlier_scans import Judge, without_misfits
from dqreg.multiway.visibility.sides import Sides
from dqreg.registration.result.result import Registration
from dqreg.rigid import pose
from dqreg.synth.many_views import turntable_views
from dqreg.synth.parts import bracket
from dqreg.trust.records import Code, Reason, Verdict
from tests.multiway.edges_of_truth import edges_of, registration

COUNT = 6


@pytest.fixture(scope="module")
def made() -> tuple[tuple[View, ...], np.ndarray]:
    views = turntable_views(bracket(), COUNT, pixels=30, rng=np.random.default_rng(0))
    scans = [PointCloud(points, viewpoint=eye) for points, eye in zip(views.scans, views.viewpoints, strict=True)]
    return read_views(scans, 0), pose.inverse(views.T_world_scan[0]) @ views.T_world_scan


def judge_of(views: tuple[View, ...]) -> Judge:
    size = typical_size(views)
    return Judge(Sides.of(views, "any"), COUNT, 0, size, 1e-3 * size, {})


def said(T: np.ndarray, size: float, *codes: Code) -> Registration:
    """What a registration to all others says."""
    found = registration(T, np.diag((1e-3 * np.r_[[1.0] * 3, [size] * 3]) ** 2), np.zeros(3))
    level = "accepted" if codes == ("accepted",) else "suspect"
    return dataclasses.replace(found, verdict=Verdict(level, tuple(Reason("made by hand", code) for code in codes)))


@pytest.mark.parametrize(("code", "stays"), [("weakly_constrained", True), ("deviating_patches", False)])
def test_a_scan_goes_only_where_something_speaks_against_its_pose(
    made: tuple[tuple[View, ...], np.ndarray], monkeypatch: pytest.MonkeyPatch, code: Code, stays: bool
) -> None:
    views, T = made
    judge = judge_of(views)
    ring = [(k, (k + step) % COUNT) for k in range(COUNT) for step in (1, 2)]
    edges = edges_of(T, ring, 1e-3, 0)
    # Nothing accepted holds the last scan: its loops confirm it.
    doubtful = said(np.eye(4), 1.0, "weakly_constrained").verdict
    edges = [
        dataclasses.replace(e, registration=dataclasses.replace(e.registration, verdict=doubtful))
        if COUNT - 1 in (e.target, e.source)
        else e
        for e in edges
    ]
    selection = judge(edges)
    assert np.isfinite(selection.T_world_scan[COUNT - 1]).all()
    monkeypatch.setattr(outlier_scans, "register", lambda cloud, model, start, **_: said(start, judge.size, code))
    _, found = without_misfits(views, judge, selection, "fast", 0)
    assert np.isfinite(found.T_world_scan[COUNT - 1]).all() == stays


def test_of_two_suspect_edges_the_one_that_nothing_speaks_against_is_better() -> None:
    first, second = edges_of(np.tile(np.eye(4), (2, 1, 1)), [(0, 1), (0, 1)], 1e-3, 0)
    wrong = dataclasses.replace(first, registration=said(np.eye(4), 1.0, "faces_apart", "weakly_constrained"))
    loose = dataclasses.replace(second, registration=said(np.eye(4), 1.0, "weakly_constrained", "not_converged"))
    assert is_refused(wrong)
    assert not is_refused(loose)
    assert better(wrong, loose) is loose
    assert better(loose, wrong) is loose
