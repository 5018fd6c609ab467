from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings

from dqreg.errors import InputError
from dqreg.rigid._operands import (
    as_directions,
    as_poses,
    as_quaternions,
    as_rigid_poses,
    as_rotations,
    as_triples,
    as_unit_quaternions,
)
from tests.strategies import floats, rotations, unit_vectors

fast = settings(deadline=None, max_examples=40)


def test_a_float64_array_is_taken_as_it_is():
    wide = np.arange(24.0).reshape(2, 12)[:, ::3]
    assert as_quaternions(wide, "q") is wide
    assert as_triples(wide[:, :3], "v").base is not None


def test_everything_else_becomes_float64():
    assert as_quaternions([1, 0, 0, 0], "q").dtype == np.float64
    assert as_poses(np.eye(4, dtype=np.float32), "T").dtype == np.float64


@fast
@given(unit_vectors(), floats(1e-300, 1e300))
def test_directions_lose_their_length_only(u, length):
    np.testing.assert_allclose(as_directions(length * u, "axis"), u, atol=1e-15)


@fast
@given(rotations())
def test_rotations_pass_and_their_mirror_images_do_not(R):
    assert as_rotations(R, "R") is R
    with pytest.raises(InputError, match="R holds a mirror image"):
        as_rotations(-R, "R")


@pytest.mark.parametrize(
    ("check", "bad"),
    [
        (as_quaternions, np.zeros((4, 3))),
        (as_quaternions, 1.0),
        (as_unit_quaternions, np.zeros(4)),
        (as_unit_quaternions, [[1, 0, 0, 0], [np.inf, 0, 0, 0]]),
        (as_triples, np.zeros((3, 2))),
        (as_directions, [[0, 0, 1], [0, 0, 0]]),
        (as_directions, [0, 0, np.inf]),
        (as_rotations, np.eye(3) * 1.01),
        (as_poses, np.eye(3)),
        (as_triples, "abc"),
    ],
)
def test_errors_name_the_argument(check, bad):
    with pytest.raises(InputError, match=r"^thing must"):
        check(bad, "thing")


def test_rounded_rotations_are_projected_and_good_ones_untouched():
    """Of a stack, only those that were rounded change, each to the rotation that one alone becomes."""
    good = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    rounded = np.array([[0.862, 0.011, -0.507], [-0.139, 0.967, -0.215], [0.487, 0.255, 0.835]])
    found = as_rotations(np.stack([good, rounded]), "R")
    np.testing.assert_array_equal(found[0], good)
    np.testing.assert_array_equal(found[1], as_rotations(rounded, "R"))
    np.testing.assert_allclose(found[1] @ found[1].T, np.eye(3), atol=1e-15)
    T = np.tile(np.eye(4)[:3], (2, 1, 1))
    T[:, :, :3] = np.stack([good, rounded])
    np.testing.assert_array_equal(as_rigid_poses(T, "T")[:, :3, :3], found)
    assert as_poses(T, "T").shape == (2, 4, 4)
