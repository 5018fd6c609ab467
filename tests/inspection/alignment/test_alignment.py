"""Datum and point alignments: by hand, under poses that are known because they were applied, and by simulation."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import DegenerateGeometryError, InputError
from dqreg.geometry import Mesh
from dqreg.inspection import Datum, Feature, align_datums, align_points, fit_feature, part_faces
from dqreg.inspection.part_faces import nearest_face
from dqreg.rigid import pose, twist
from dqreg.synth.parts import bracket

PART = Mesh(*bracket())
FACES = part_faces(PART)
# A pose 6 degrees and some mm off; alignments begin at the identity.
T_TRUE = twist.exp(np.array([0.08, -0.05, 0.06, 3.0, -2.0, 1.0]))


def face(place: tuple[float, float, float]) -> Feature:
    found = nearest_face(PART, FACES, place).feature
    assert found is not None
    return found


BOTTOM, FRONT, SIDE = (face(p) for p in ((60.0, 40.0, 0.0), (60.0, 0.0, 5.0), (120.0, 40.0, 5.0)))
HOLES = [k.feature for k in FACES if k.kind == "cylinder" and k.is_hole and k.feature and abs(k.feature.axis[2]) > 0.9]


def datums(*nominal: Feature, T: np.ndarray = T_TRUE) -> list[Datum]:
    """Datums whose measured features are the nominal ones under the inverse of a pose."""
    return [Datum("ABC"[k], f.moved(pose.inverse(T)), f) for k, f in enumerate(nominal)]


def test_faces_of_the_bracket_have_its_dimensions() -> None:
    # The bracket's own defaults: large hole 16, small holes 9, fillet of radius 10, boss 28, bore 14.
    cylinders = [(f.feature.diameter, f.is_hole) for f in FACES if f.kind == "cylinder" and f.feature]
    expected = [(9.0, True)] * 3 + [(14.0, True), (16.0, True), (20.0, False), (28.0, False)]
    np.testing.assert_allclose(sorted(cylinders), expected, atol=1e-6)
    assert {f.kind for f in FACES} == {"plane", "cylinder"}
    np.testing.assert_allclose(BOTTOM.axis, [0.0, 0.0, -1.0], atol=1e-12)
    assert sum(f.area for f in FACES) == pytest.approx(PART.face_areas.sum())


@pytest.mark.parametrize(
    ("nominal", "counts"),
    [
        ((BOTTOM, FRONT, SIDE), {"A": 3, "B": 2, "C": 1}),
        ((SIDE, BOTTOM, FRONT), {"A": 3, "B": 2, "C": 1}),
        ((BOTTOM, HOLES[0], HOLES[1]), {"A": 3, "B": 2, "C": 1}),
        ((BOTTOM, HOLES[0], FRONT), {"A": 3, "B": 2, "C": 1}),
        ((HOLES[0], BOTTOM, FRONT), {"A": 4, "B": 1, "C": 1}),
    ],
)
def test_datums_in_any_order_give_the_pose_back(nominal: tuple[Feature, ...], counts: dict[str, int]) -> None:
    found = align_datums(datums(*nominal))
    np.testing.assert_allclose(found.T_target_source, T_TRUE, atol=1e-12 * PART.diagonal)
    assert found.constrained == counts


def test_the_first_datum_wins() -> None:
    # The front is measured half a degree out of square: laid on after the bottom, it takes only what is left.
    tilted = FRONT.moved(pose.about(twist.exp([np.deg2rad(0.5), 0.0, 0.0, 0.0, 0.0, 0.0]), FRONT.point))
    given = [Datum("A", BOTTOM, BOTTOM), Datum("B", tilted, FRONT), Datum("C", SIDE, SIDE)]
    np.testing.assert_allclose(align_datums(given).T_target_source, np.eye(4), atol=1e-12 * PART.diagonal)
    turned = align_datums([given[1], given[0], given[2]]).T_target_source
    assert pose.angle_between(turned, np.eye(4)) == pytest.approx(np.deg2rad(0.5), rel=1e-9)
    np.testing.assert_allclose(turned[:3, :3] @ tilted.axis, FRONT.axis, atol=1e-12)


def test_a_tilted_hole_does_not_turn_the_part() -> None:
    # Its place on the bottom counts, its tilt does not: the rotation is left to the front.
    tilt = pose.about(twist.exp([0.0, 0.02, 0.0, 0.0, 0.0, 0.0]), HOLES[0].point * [1, 1, 0])
    given = [Datum("A", BOTTOM, BOTTOM), Datum("B", HOLES[0].moved(tilt), HOLES[0]), Datum("C", FRONT, FRONT)]
    np.testing.assert_allclose(align_datums(given).T_target_source, np.eye(4), atol=1e-12 * PART.diagonal)


def test_the_covariance_is_that_of_repeated_measurements() -> None:
    rng, squares = np.random.default_rng(4), []
    for _ in range(40):
        measured = []
        for nominal in (BOTTOM, FRONT, SIDE):
            across = rng.uniform(-20.0, 20.0, (40, 2)) @ nominal.frame[:, :2].T + nominal.point
            points = across + rng.normal(0.0, 0.02, (40, 1)) * nominal.axis
            measured.append(fit_feature(points, "plane", normals=np.tile(nominal.axis, (40, 1))))
        found = align_datums([Datum(n, m, f) for n, m, f in zip("ABC", measured, (BOTTOM, FRONT, SIDE), strict=True)])
        error = twist.log(pose.about(found.T_target_source, -found.centre))
        squares.append(error @ np.linalg.solve(found.covariance, error))
    # Six degrees of freedom: the mean of 40 scatters by sqrt(12 / 40) = 0.55.
    assert np.mean(squares) == pytest.approx(6.0, abs=2.5)


def test_datums_that_leave_a_motion_are_named() -> None:
    with pytest.raises(DegenerateGeometryError, match=r"constrain 5 of six degrees of freedom \(A 3, B 2, C 0\)"):
        align_datums([*datums(BOTTOM, FRONT), Datum("C", BOTTOM, BOTTOM)])
    with pytest.raises(InputError, match="datum A: a plane was measured where the nominal feature is a cylinder"):
        align_datums([Datum("A", BOTTOM, HOLES[0])])
    with pytest.raises(InputError, match="needs datums"):
        align_datums([])


def test_six_reference_points_hold_exactly_and_more_are_balanced() -> None:
    rng = np.random.default_rng(0)
    nominals = rng.uniform(0.0, 100.0, (9, 3))
    directions = np.eye(3)[[2, 2, 2, 1, 1, 0, 2, 1, 0]]
    points = pose.apply(pose.inverse(T_TRUE), nominals)
    found = align_points(points[:6], nominals[:6], directions[:6], sigma=0.01)
    np.testing.assert_allclose(found.T_target_source, T_TRUE, atol=1e-12 * 170.0)
    # One point measured 0.3 off: six follow it, nine share it out by their sigmas.
    moved = points.copy()
    moved[0] += pose.rotate(pose.inverse(T_TRUE), [[0.0, 0.0, 0.3]])[0]
    assert np.abs(align_points(moved[:6], nominals[:6], directions[:6]).residuals).max() < 1e-10
    sure = align_points(moved, nominals, directions, sigma=np.r_[1e-4, np.ones(8)])
    assert abs(sure.residuals[0]) < 1e-6
    with pytest.raises(DegenerateGeometryError, match="the points leave"):
        align_points(points[:3], nominals[:3], directions[:3])
    with pytest.raises(InputError, match="as many"):
        align_points(points, nominals[:3], directions)


def test_the_covariance_of_points_is_that_of_their_sigmas() -> None:
    rng, squares = np.random.default_rng(1), []
    nominals, directions = rng.uniform(0.0, 100.0, (12, 3)), np.eye(3)[np.arange(12) % 3]
    for _ in range(200):
        noisy = nominals + rng.normal(0.0, 0.05, (12, 1)) * directions
        found = align_points(noisy, nominals, directions, sigma=0.05)
        error = twist.log(pose.about(found.T_target_source, -found.centre))
        squares.append(error @ np.linalg.solve(found.covariance, error))
    # The mean of 200 scatters by sqrt(12 / 200) = 0.24.
    assert np.mean(squares) == pytest.approx(6.0, abs=1.0)
