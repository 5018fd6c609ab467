from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import BoolArray, FloatArray
from dqreg.trust.deformed_faces import in_their_face
from dqreg.trust.patch_tests import PATCH_POINTS

UP, ALONG = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0])


def face(origin: FloatArray, one: FloatArray, two: FloatArray, side: int, seed: int = 0) -> FloatArray:
    """Feet on a square face of so many patches along each side, 32 points a patch."""
    rng = np.random.default_rng(seed)
    i, j = (x.ravel()[:, None, None] for x in np.meshgrid(np.arange(side), np.arange(side), indexing="ij"))
    u, v = rng.uniform(size=(2, side * side, PATCH_POINTS, 1))
    points = origin + (i + u) * one + (j + v) * two
    return np.asarray(points.reshape(-1, 3))


def asked(*faces: tuple[FloatArray, FloatArray, BoolArray]) -> list[int]:
    """How many patches of each face are deformed, of feet, a normal, and which of the patches are off."""
    feet = np.concatenate([points for points, _, _ in faces])
    normals = np.concatenate([np.broadcast_to(normal, points.shape) for points, normal, _ in faces])
    off = np.concatenate([which for _, _, which in faces])
    found = in_their_face(feet, normals, off, np.ones(len(off), dtype=bool))
    assert not found[~off].any()
    ends = np.cumsum([len(which) for _, _, which in faces])[:-1]
    return [int(np.count_nonzero(part)) for part in np.split(found, ends)]


TOP = face(np.zeros(3), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), 8)
END = face(np.array([8.0, 0.0, 0.0]), np.array([0.0, 0.0, -1.0]), np.array([0.0, 1.0, 0.0]), 8)
WHOLE, NONE = np.ones(64, dtype=bool), np.zeros(64, dtype=bool)


def rows(count: int) -> BoolArray:
    """The last so many rows of eight patches."""
    return np.arange(64) >= 64 - 8 * count


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_is_off_of_a_face_in_its_place_is_deformed(count: int) -> None:
    assert asked((TOP, UP, rows(count)), (END, ALONG, NONE)) == [8 * count, 0]


def test_a_face_that_is_off_as_a_whole_or_for_the_most_part_is_none() -> None:
    # Beside a face in its place that looks another way; and tilted through its place, so that a band of it is on.
    assert asked((TOP, UP, NONE), (END, ALONG, WHOLE)) == [0, 0]
    assert asked((TOP, UP, rows(8) & ~((np.arange(64) // 8 > 2) & (np.arange(64) // 8 < 6))), (END, ALONG, NONE)) == [
        0,
        0,
    ]


def test_a_parallel_face_beyond_a_step_is_another_face() -> None:
    beyond, wider = TOP + np.array([8.0, 0.0, 1.0]), TOP + np.array([0.0, 8.0, 0.0])
    assert asked((TOP, UP, NONE), (wider, UP, NONE), (beyond, UP, rows(2))) == [0, 0, 16]
    assert asked((TOP, UP, NONE), (wider, UP, NONE), (beyond, UP, WHOLE)) == [0, 0, 0]
    # What continues it without a step is the same face.
    assert asked((TOP, UP, NONE), (wider, UP, NONE), (TOP + np.array([8.0, 0.0, 0.0]), UP, WHOLE)) == [0, 0, 64]


def test_the_other_side_of_a_sheet_is_another_face() -> None:
    assert asked((TOP, UP, NONE), (TOP - 0.1 * UP, -UP, WHOLE)) == [0, 0]


def test_a_face_that_curves_on_has_its_say_only_where_it_looks_alike() -> None:
    # A quarter of a tube leads from a base in its place to a wall that is off as a whole.
    turns = np.repeat(np.linspace(0.0, np.pi / 2, 12), 8)
    rng = np.random.default_rng(0)
    t = turns[:, None] + rng.uniform(-0.06, 0.06, (96, PATCH_POINTS))
    y = np.tile(np.arange(8.0), 12)[:, None] + rng.uniform(size=t.shape)
    normals = np.stack([np.sin(t), np.zeros_like(t), np.cos(t)], axis=-1)
    feet = 8.0 * normals + y[..., None] * [0.0, 1.0, 0.0]
    off = turns > np.deg2rad(60.0)
    found = in_their_face(feet.reshape(-1, 3), normals.reshape(-1, 3), off, np.ones(96, dtype=bool))
    # Those at the rim of what is off may have most of their like on the target; the wall itself has none.
    assert not found[turns > np.deg2rad(75.0)].any()
