from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.geometry.surface import Closest
from dqreg.icp import Correspondences, InlierMixture, NormalAngle, WithinDistance
from dqreg.icp.weighing import weigh
from dqreg.kernels import threads
from dqreg.rigid import pose
from tests.icp.scenes import made_pairs, motion

MIXTURE = InlierMixture(scale=0.3, inlier_fraction=0.7, limit=2.0)
REJECTORS = (WithinDistance(1.5), NormalAngle(np.deg2rad(60.0)))


class SameMixture(InlierMixture):
    """Weighed by NumPy, array by array: the one pass is for the mixture itself."""


def pairs_of(count: int, *, signed: bool, many: bool, seed: int = 0) -> Correspondences:
    """Correspondences at random, some without a normal on either side, and some far apart."""
    rng = np.random.default_rng(seed)
    own, normals = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in rng.normal(size=(2, count, 3)))
    own[::7], normals[::11] = 0.0, 0.0
    distances = np.abs(rng.normal(size=count))
    distances[::13] = 5.0
    scan = dataclasses.replace(
        made_pairs(count).scan,
        points=rng.normal(size=(count, 3)),
        normals=own,
        levers=np.ones(count),
        residuals=np.ones(count),
        counts=rng.integers(1, 9, count).astype(float) if many else None,
        within=rng.uniform(0.0, 0.1, count) if many else None,
    )
    closest = Closest(rng.normal(size=(count, 3)), normals, distances, np.zeros(count, dtype=np.int64))
    return Correspondences(scan, motion(0.4, 1.0), closest, signed)


@pytest.mark.parametrize("signed", [False, True])
@pytest.mark.parametrize("many", [False, True])
@pytest.mark.parametrize("others", [0, 1])
def test_one_pass_gives_what_array_by_array_gives(signed: bool, many: bool, others: int) -> None:
    pairs = pairs_of(1_003, signed=signed, many=many)
    odd = [lambda p: np.where(np.arange(len(p.distances)) % 3, 1.0, 0.0)] * others
    one = weigh(pairs, MIXTURE, (*REJECTORS, *odd))
    other = weigh(pairs, SameMixture(**vars(MIXTURE)), (*REJECTORS, *odd))
    np.testing.assert_allclose(one.weights, other.weights, rtol=1e-12, atol=0)
    assert 0 < one.used == other.used < 1_003
    assert (one.energy, one.total) == pytest.approx((other.energy, other.total), rel=1e-12)
    assert one.mean_square == pytest.approx(other.mean_square, rel=1e-12)


def test_the_energy_falls_where_distances_fall() -> None:
    pairs = pairs_of(500, signed=True, many=False)
    nearer = dataclasses.replace(pairs.closest, distances=0.9 * pairs.closest.distances)
    energies = [weigh(p, MIXTURE, REJECTORS).energy for p in (dataclasses.replace(pairs, closest=nearer), pairs)]
    assert 0.0 < energies[0] < energies[1]


def test_the_bits_do_not_depend_on_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs, found = pairs_of(40_000, signed=False, many=False), []
    for count in (1, 3):
        monkeypatch.setattr(threads, "thread_count", lambda count=count: count)
        found.append(weigh(pairs, MIXTURE, REJECTORS))
    assert np.array_equal(found[0].weights, found[1].weights)
    assert (found[0].energy, found[0].total) == (found[1].energy, found[1].total)


def test_some_of_the_correspondences_are_those_of_some_points() -> None:
    pairs = pairs_of(50, signed=False, many=False)
    some = pairs.taken(np.arange(0, 50, 7))
    np.testing.assert_array_equal(some.distances, pairs.distances[::7])
    np.testing.assert_allclose(some.moved, pose.apply(pairs.T_target_source, pairs.scan.points[::7]), atol=1e-12)


@dataclasses.dataclass(frozen=True)
class Above:
    """A weight of a user's: its limit is a height, whatever the name."""

    limit: float

    def __call__(self, pairs: Correspondences) -> np.ndarray:
        return np.where(pairs.closest.points[:, 2] > self.limit, 1.0, 0.0)


def test_only_a_limit_of_distances_says_what_a_rejected_pair_costs() -> None:
    pairs = pairs_of(500, signed=True, many=False)
    named, unnamed = Above(0.01), lambda p: Above(0.01)(p)
    energies = [weigh(pairs, SameMixture(**vars(MIXTURE)), (WithinDistance(1.5), x)).energy for x in (named, unnamed)]
    assert energies[0] == energies[1]
