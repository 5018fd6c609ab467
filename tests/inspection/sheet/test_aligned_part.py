"""Alignments of a plan as steps, each named; reference points from a scan; sections."""

from __future__ import annotations

import copy
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.inspection import Deviations, inspect, measure_deviations
from dqreg.inspection.plan.file import plan_of
from dqreg.report.inspection_table import frame_words
from dqreg.rigid import pose, twist
from dqreg.synth.parts import box

PART = Mesh(*box((30.0, 20.0, 10.0)))
SURFACE = MeshSurface(PART)
T_TRUE = twist.exp([1e-3, -1e-3, 1.5e-3, 0.05, -0.04, 0.06])


def number(side: tuple[float, float, float]) -> int:
    return int(faces_of(PART)[1][int(np.argmax(PART.face_normals @ side))])


TOP, BOTTOM, RIGHT, BACK = (number(n) for n in ((0, 0, 1.0), (0, 0, -1.0), (1.0, 0, 0), (0, 1.0, 0)))
HEIGHT = {"name": "height", "kind": "distance", "faces": [BOTTOM, TOP], "tolerance": 0.2}
SIX = [[10, 5, 5], [-10, 5, 5], [0, -8, 5], [10, 10, 0], [-10, 10, 0], [15, 0, 0]]
PLAN: dict[str, Any] = {
    "datum": [{"name": n, "face": f} for n, f in zip("ABC", (TOP, BACK, RIGHT), strict=True)],
    "alignment": [
        {"name": "all faces", "kind": "best-fit"},
        {"name": "within 0.05", "kind": "tolerance", "tolerance": 0.05},
        {"name": "A|B|C", "kind": "datums"},
    ],
    "characteristic": [HEIGHT],
    "section": [{"name": "middle", "point": [0, 1, 0], "normal": [0, 1, 0]}],
}


def scanned(thick: float = 0.1) -> Deviations:
    """The block with its bottom that much lower, under the inverse of a pose."""
    cloud = sample_mesh(PART, 4_000, np.random.default_rng(0))
    points = cloud.points.copy()
    points[points[:, 2] < -4.999, 2] -= thick
    points += 0.003 * np.random.default_rng(1).normal(size=points.shape)
    return measure_deviations(pose.apply(pose.inverse(T_TRUE), points), PART, SURFACE, reach=2.0)


def refused_in(plan: dict[str, Any], **entries: Any) -> str:
    """Why the one row that stands behind the characteristics was not measured."""
    found = inspect(scanned(), plan_of({"section": [], **plan, **entries}))
    assert found.outcome == "undecided"
    return next(row for row in found.characteristics if row.kind in ("alignment", "section")).remark


def error_of(T: np.ndarray) -> float:
    return float(np.abs(pose.apply(T @ pose.inverse(T_TRUE), PART.vertices) - PART.vertices).max())


@pytest.mark.parametrize("last", ["datums", "points", "minimax"])
def test_steps_follow_each_other(last: str) -> None:
    plan = copy.deepcopy(PLAN)
    if last == "points":
        plan["alignment"][2] = {"name": "RPS", "kind": "points", "points": SIX}
    elif last == "minimax":
        plan["alignment"][2] = {"name": "largest least", "kind": "minimax", "dof": "tz"}
    found = inspect(scanned(), plan_of(plan))
    assert [step.kind for step in found.steps] == ["best-fit", "tolerance", last]
    assert frame_words(found) == ", then ".join(step.name for step in found.steps)
    assert found.alignment is not None
    # Datums and points hold the good faces; the smallest largest deviation shares the error out: 0.05 of it.
    expected = 0.05 if last == "minimax" else 0.0
    assert error_of(found.alignment.T_target_source) == pytest.approx(expected, abs=0.006)
    (row,) = found.characteristics
    assert abs(row.value - 10.1) <= row.uncertainty
    ((name, cut),) = found.sections
    assert name == "middle"
    low = cut.outward[:, 2] < -0.5
    assert np.nanmedian(cut.values[low]) == pytest.approx(0.1 - expected, abs=0.005)


def test_a_best_fit_spreads_a_bend_and_datums_show_it() -> None:
    # The figure of the inspection page: a plate bent by 0.6 mm.
    page = Path(__file__).parents[3] / "docs" / "bent_part.py"
    least, datums = runpy.run_path(str(page))["sections"]().values()
    assert np.nanmax(np.abs(least.values)) < 0.15
    assert np.nanmin(datums.values) < -0.45


@pytest.mark.parametrize(
    ("step", "words"),
    [
        ({"kind": "bestfit"}, "alignment 1: kind must be one of best-fit"),
        ({"kind": "tolerance"}, "a tolerance fit needs tolerance"),
        ({"kind": "best-fit", "faces": [0], "weights": [1, 2]}, "as many numbers as faces"),
        ({"kind": "points"}, "goes with kind = "),
        ({"kind": "points", "points": [[1, 2]]}, "a point is"),
        ({"kind": "best-fit", "face": 3}, "did you mean faces"),
        ({"kind": "outside", "plus": -1.0}, "a tolerance is above 0"),
        ({"kind": "best-fit", "dof": 3}, "dof is text"),
        ({"kind": "best-fit", "prior": 0.1}, "alignment 1: prior must be a table"),
        ({"kind": "best-fit", "prior": {"rotation": 0.1}}, "alignment 1: prior needs rotation, degrees, and transl"),
        ({"kind": "best-fit", "prior": {"rotation": 0.1, "shift": 1}}, "'shift' is not known"),
        ({"kind": "best-fit", "prior": {"rotation": 0, "translation": 1}}, "rotation is one or three standard dev"),
        ({"kind": "best-fit", "prior": {"rotation": 1, "translation": [1, 2]}}, "translation must be three numbers"),
    ],
)
def test_a_wrong_step_is_named(step: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        plan_of({**PLAN, "alignment": [step]})


def prior(rotation: Any, translation: Any) -> dict[str, Any]:
    return {"rotation": rotation, "translation": translation}


@pytest.mark.parametrize(
    "step",
    [
        {"kind": "best-fit"},
        {"kind": "datums"},
        {"kind": "points", "points": SIX},
        {"kind": "tolerance", "tolerance": 0.05},
        {"kind": "minimax"},
        {"kind": "outside", "minus": 1.0},
    ],
)
def test_a_prior_holds_as_it_is_sure(step: dict[str, Any]) -> None:
    scan = scanned()

    def moved(**more: Any) -> np.ndarray:
        found = inspect(scan, plan_of({**PLAN, "alignment": [{**step, **more}], "section": []})).alignment
        assert found is not None
        return np.asarray(found.T_target_source)

    free = moved()
    # A prior of kilometres says nothing; the step of some 0.05 mm is far from one of a nanometre.
    np.testing.assert_allclose(moved(prior=prior(170.0, 1e6)), free, atol=2e-4)
    if step["kind"] != "datums":
        # Datums decide what they constrain; a prior what they leave open.
        np.testing.assert_allclose(moved(prior=prior(1e-8, 1e-7)), np.eye(4), atol=5e-6)


def test_a_prior_decides_what_the_faces_leave_open() -> None:
    scan = scanned()
    known = prior([0.05, 0.05, 0.1], 0.02)

    def of(**step: Any) -> Any:
        return inspect(scan, plan_of({**PLAN, "alignment": [step], "section": []})).alignment

    top = of(kind="best-fit", faces=[TOP], prior=known)
    # Along the top nothing was measured: the pose stays, as sure as it was known.
    np.testing.assert_allclose(top.T_target_source[:2, 3], 0.0, atol=2e-3)
    sigma = np.sqrt(np.diag(top.covariance))
    np.testing.assert_allclose(sigma[[2, 3, 4]], [np.deg2rad(0.1), 0.02, 0.02], rtol=0.05)
    assert (sigma[[0, 1, 5]] < [1e-4, 1e-4, 1e-3]).all()
    two = {**PLAN, "datum": PLAN["datum"][:2], "alignment": [{"kind": "datums", "prior": known}], "section": []}
    datums = inspect(scan, plan_of(two)).alignment
    assert datums is not None
    assert datums.constrained == {"A": 3, "B": 2}
    # The third datum would hold the motion along x: about the top's middle, 5 mm above that of the part.
    assert np.sqrt(datums.covariance[3, 3]) == pytest.approx(np.hypot(0.02, 5.0 * np.deg2rad(0.05)), rel=0.6)
    assert "datums constrain 5 of six" in refused_in(two, alignment="datums")


def test_what_a_step_cannot_do_is_said_with_its_name() -> None:
    far = {"name": "RPS", "kind": "points", "points": SIX[:3]}
    assert refused_in(PLAN, alignment=[far]).startswith("alignment 'RPS': the points leave")
    beside = {"name": "RPS", "kind": "points", "points": [[1e6, 5, 5], *SIX[1:]]}
    with pytest.raises(InputError, match=r"'RPS': reference point .* lies 1e\+06 beside the part"):
        inspect(scanned(), plan_of({**PLAN, "alignment": [beside]}))
    one = {"name": "top", "kind": "best-fit", "faces": [TOP]}
    assert refused_in(PLAN, alignment=[one]).startswith("alignment 'top': the chosen faces leave")
    miss = [{"name": "off", "point": [0, 99, 0], "normal": [0, 1, 0]}]
    assert refused_in(PLAN, section=miss).startswith("the plane through (0, 99, 0) misses the part")
    with pytest.raises(InputError, match="point must be three numbers"):
        plan_of({**PLAN, "section": [{"point": [0, 1]}]})
