from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dqreg.rigid import pose
from dqreg.trust import Information, covariance_of, information_of, observe_directions
from dqreg.trust.records import Direction
from tests.strategies import FloatArray, rotations, unit_vectors
from tests.trust.shapes import box, cylinder, judged, plane, sphere

NUMBER = r"(-?[\d.]+(?:e[+-]\d+)?)"
VECTOR = rf"\({NUMBER}, {NUMBER}, {NUMBER}\)"
TURN = re.compile(rf"rotation about the axis through {VECTOR} along {VECTOR}$")
SHIFT = re.compile(rf"translation along {VECTOR}$")


def split(words: str, pattern: re.Pattern[str]) -> FloatArray:
    found = pattern.search(words)
    assert found, words
    return np.array([float(number) for number in found.groups()]).reshape(-1, 3)


def free_along(turned: float) -> Direction:
    """The free motion along x that turns by so many radians at the end of the lever, 100."""
    vectors = np.eye(6)[[3, 2, 0, 1, 4, 5]].T
    c, s = np.cos(turned), np.sin(turned)
    vectors[[2, 3], :2] = [[s, c], [c, -s]]
    information = Information(np.array([0.0, 1, 1, 1, 1, 1]), vectors, 100.0, 0.1, 100.0, np.zeros(3))
    return observe_directions(information)[0]


@pytest.mark.parametrize("degrees", [6.0, 9.0])
def test_a_free_rotation_about_an_axis_far_away_is_told_as_a_translation(degrees: float) -> None:
    found = free_along(np.deg2rad(degrees))
    assert found.is_free
    np.testing.assert_allclose(split(found.words, SHIFT), [[1.0, 0.0, 0.0]], atol=0.005)
    # What is decided by the kind still knows it as a rotation about its axis, ten and six levers away.
    assert found.kind == "rotation"
    assert np.linalg.norm(found.point) == pytest.approx(100.0 / np.tan(np.deg2rad(degrees)))


def test_a_free_rotation_about_an_axis_beside_the_part_is_told_as_one() -> None:
    assert TURN.search(free_along(np.deg2rad(12.0)).words)


def free_words(points: FloatArray, normals: FloatArray, centre: FloatArray, lever: float = 1.5) -> list[str]:
    n = len(points)
    information = information_of(points, normals, np.zeros(n), np.ones(n), lever, centre)
    return sorted((d.words for d in observe_directions(information) if d.is_free), reverse=True)


@settings(deadline=None, max_examples=60)
@given(rotations(), unit_vectors(), st.sampled_from([0.0, 0.3, 1.0, 1.4, 4.0, 8.0]))
def test_a_cylinder_anywhere_spins_about_its_axis_and_slides_along_it(
    R: FloatArray, aside: FloatArray, distance: float
) -> None:
    points, normals = cylinder(np.random.default_rng(0))
    place = distance * aside
    slide, spin = free_words(points @ R.T + place, normals @ R.T, np.zeros(3))
    axis = R[:, 2]
    # Words have two decimals: each component is good to 0.005, and no sign is meant.
    for direction in (split(slide, SHIFT)[0], split(spin, TURN)[1]):
        assert min(np.abs(direction - axis).max(), np.abs(direction + axis).max()) < 0.0051
    through = split(spin, TURN)[0]
    # The point is the one of the axis nearest to the centre; it has four digits.
    nearest = place - (place @ axis) * axis
    np.testing.assert_allclose(through, nearest, atol=1e-3 * max(distance, 1e-9))


def test_a_centre_far_from_the_origin_is_in_the_words() -> None:
    points, normals = cylinder(np.random.default_rng(0))
    centre = np.array([100.0, -200.0, 50.0])
    slide, spin = free_words(points + centre + [0.5, 0.0, 0.0], normals, centre)
    assert slide == "unconstrained: translation along (0.00, 0.00, 1.00)"
    assert spin == "unconstrained: rotation about the axis through (100.5, -200, 50) along (0.00, 0.00, 1.00)"


def test_a_plane_slides_in_two_directions_and_spins_about_its_normal() -> None:
    points, normals = plane(np.random.default_rng(0))
    first, second, spin = free_words(points + np.array([0.0, 0.0, 0.7]), normals, np.zeros(3))
    a, b = (split(words, SHIFT)[0] for words in (first, second))
    assert (a[2], b[2]) == (0.0, 0.0)
    assert abs(a @ b) < 0.02
    np.testing.assert_array_equal(split(spin, TURN)[1], [0.0, 0.0, 1.0])


@pytest.mark.parametrize("place", [[0.0, 0, 0], [1.0, 0, 0], [1.0, -2.0, 0.5]])
def test_a_sphere_turns_about_axes_through_its_middle(place: list[float]) -> None:
    points, normals = sphere(np.random.default_rng(0))
    words = free_words(points + place, normals, np.zeros(3))
    assert len(words) == 3
    for sentence in words:
        through, axis = split(sentence, TURN)
        # The middle of the sphere lies on the axis, to the two decimals of its direction.
        offset = np.array(place) - through
        assert np.linalg.norm(offset - (offset @ axis) * axis) < 0.01 * (1.0 + np.linalg.norm(place))


def test_a_box_is_held_in_six_ways_the_weakest_first() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng)
    directions = observe_directions(judged(points, normals, 1e-3 * rng.normal(size=len(points))))
    assert len(directions) == 6
    assert not any(d.is_free or "constrained" in d.words for d in directions)
    strengths = [d.strength for d in directions]
    assert strengths == sorted(strengths)
    assert strengths[0] > 0.0


def test_sigmas_are_the_roots_of_the_covariance_in_displacements() -> None:
    rng = np.random.default_rng(0)
    points, normals = box(rng)
    information = judged(points, normals, 1e-3 * rng.normal(size=len(points)))
    scale = np.r_[[1.5] * 3, [1.0] * 3]
    displacement = covariance_of(information) * scale[:, None] * scale
    expected = np.sqrt(np.linalg.eigvalsh(displacement))[::-1]
    np.testing.assert_allclose([d.sigma for d in observe_directions(information)], expected, rtol=1e-9)


def test_what_is_free_has_no_sigma() -> None:
    points, normals = cylinder(np.random.default_rng(0))
    sigmas = [d.sigma for d in observe_directions(judged(points, normals, 1e-3))]
    assert np.isnan(sigmas[:2]).all()
    assert np.isfinite(sigmas[2:]).all()


def test_words_do_not_depend_on_the_unit_but_for_the_place() -> None:
    points, normals = cylinder(np.random.default_rng(0))
    T = pose.random(np.random.default_rng(5))
    turned = pose.rotate(T, points), pose.rotate(T, normals)
    metres = free_words(turned[0], turned[1], np.zeros(3))
    millimetres = free_words(1e3 * turned[0], turned[1], np.zeros(3), lever=1.5e3)
    assert metres[0] == millimetres[0]
    assert metres[1].rsplit("along")[-1] == millimetres[1].rsplit("along")[-1]


@settings(deadline=None, max_examples=60)
@given(rotations(), unit_vectors())
def test_values_and_words_are_one(R: FloatArray, aside: FloatArray) -> None:
    points, normals = cylinder(np.random.default_rng(0))
    place = 3.0 * aside
    n = len(points)
    information = information_of(points @ R.T + place, normals @ R.T, np.zeros(n), np.ones(n), 1.5, np.zeros(3))
    for direction in observe_directions(information):
        assert direction.is_free == ("unconstrained: " in direction.words)
        assert np.linalg.norm(direction.axis) == pytest.approx(1.0)
        through = split(direction.words, TURN if direction.kind == "rotation" else SHIFT)
        np.testing.assert_allclose(through[-1], direction.axis, atol=0.0051)
        if direction.kind == "rotation":
            np.testing.assert_allclose(through[0], direction.point, rtol=1e-3, atol=1e-5)
            # The point of the axis nearest to the centre.
            assert np.dot(direction.point, direction.axis) == pytest.approx(0.0, abs=1e-9)
        else:
            assert direction.point == (0.0, 0.0, 0.0)
