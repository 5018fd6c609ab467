from __future__ import annotations

import numpy as np

from dqreg.kernels.search.pair_poses import pair_poses
from dqreg.solvers.oriented_pairs import OrientedPairs, poses_from_pairs


def cloud(seed: int, count: int = 60) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(count, 3))
    return rng.normal(size=(count, 3)), directions / np.linalg.norm(directions, axis=1, keepdims=True)


def test_poses_are_those_of_the_plain_pairs_and_agree_as_they_turn_the_directions() -> None:
    # Oracle: the solver, one sign at a time.
    ours, theirs, rng = cloud(0), cloud(1), np.random.default_rng(2)
    i, a = rng.integers(0, 30, size=(2, 4_000))
    j, b = rng.integers(30, 60, size=(2, 4_000))
    R, t, agree = np.zeros((2, 4_000, 3, 3)), np.zeros((2, 4_000, 3)), np.zeros((2, 4_000), dtype=bool)
    for first, last in ((0, 1_500), (1_500, 4_000)):
        pair_poses(first, last, *ours, i, j, *theirs, a, b, 0.3, 0.6, R, t, agree)
    source, target = OrientedPairs.of(*ours, i, j), OrientedPairs.of(*theirs, a, b)
    guides = np.abs(source.cosines[:, :2]).min(axis=1)
    for way, sign in enumerate((1.0, -1.0)):
        signed = OrientedPairs(target.middle, target.length, target.along, sign * target.first, sign * target.second)
        plain, shifts = poses_from_pairs(source, signed)
        turned = [np.einsum("nij,nj->ni", plain, known) for known in (ours[1][i], ours[1][j])]
        cosines = [
            np.abs(np.einsum("ni,ni->n", x, y)) for x, y in zip(turned, (theirs[1][a], theirs[1][b]), strict=True)
        ]
        expected = (np.minimum(*cosines) > 0.6) & (guides < 0.3 if way else True)
        assert 100 < expected.sum() < 3_000
        np.testing.assert_array_equal(agree[way], expected)
        np.testing.assert_allclose(R[way, expected], plain[expected], atol=1e-12)
        np.testing.assert_allclose(t[way, expected], shifts[expected], atol=1e-12)
