"""What is left between two clouds of one surface: nothing, a strain, a ripple, or a wall laid on its other side."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.rigid import pose, twist
from dqreg.trust.limits import FACES_APART_SHARE
from dqreg.trust.overlap import MIN_COMPARISONS, IndexedPoints, Overlap
from tests.strategies import FloatArray
from tests.trust.shapes import box, sphere

SURE, SAME = np.zeros((6, 6)), np.eye(4)
# Of shapes of extent 3.
SIZE, NOISE = 3.0, 0.001


def cloud(seed: int, make=box, count: int = 3_000, noise: float = NOISE) -> FloatArray:
    rng = np.random.default_rng(seed)
    points, _ = make(rng, count)
    return points + noise * rng.normal(size=points.shape)


def between(one: FloatArray, other: FloatArray) -> Overlap:
    found = compared(one, other)
    assert found is not None
    return found


def compared(one: FloatArray, other: FloatArray, T: FloatArray = SAME) -> Overlap | None:
    return Overlap.of(IndexedPoints.of(one), IndexedPoints.of(other), T)


@pytest.mark.parametrize("make", [box, sphere])
def test_two_clouds_of_one_surface_differ_by_their_noise(make) -> None:
    # The mean plane of both sides is free of the curvature between points that stand 0.05 apart.
    found = between(cloud(1, make), cloud(2, make))
    assert np.sqrt(np.mean(found.residuals**2)) < 3.0 * NOISE
    assert found.apart(SIZE, SURE) == 0.0
    assert found.waviness() == 0.0
    assert found.deformation(SIZE) == 0.0
    assert not found.strain(SIZE).is_strained
    assert not found.strain(SIZE).is_bent


def test_the_best_step_takes_a_displacement_back() -> None:
    displaced = twist.exp(np.array([0.004, -0.003, 0.005, 0.004, 0.006, -0.005]))
    T, gain = between(pose.apply(displaced, cloud(1)), cloud(2)).best_step()
    # A third of 2,000 places with the noise of both constrains each rotation with a lever of about a half: four
    # standard deviations of 1.4 / (0.5 sqrt(700)) noises each.
    np.testing.assert_allclose(T @ displaced, np.eye(4), atol=0.4 * NOISE)
    assert gain > 1_000.0
    # At the pose itself what six numbers gain by chance: about three.
    assert between(cloud(1), cloud(2)).best_step()[1] < 15.0


def test_a_cloud_that_is_longer_is_told_with_its_axis() -> None:
    found = between(cloud(1) * [1.02, 1.0, 1.0], cloud(2)).strain(SIZE)
    assert found.is_strained
    assert found.value == pytest.approx(0.02, rel=0.2)
    assert abs(found.along[0]) > 0.99


@pytest.mark.parametrize(("share", "noise"), [(0.004, NOISE), (0.002, 0.2 * NOISE)])
def test_a_ripple_is_no_strain_and_lies_apart(share: float, noise: float) -> None:
    # The smaller one is below 0.2 % of the size almost everywhere, and twenty times the noise of both.
    points = cloud(1, noise=noise)
    ripple = share * SIZE * np.sin(6.0 * points[:, :1])
    found = between(points + ripple * [0.0, 1.0, 1.0], cloud(2, noise=noise))
    assert found.apart(SIZE, SURE) > FACES_APART_SHARE
    # Half of its surface looks along the wave, whose mean square is a half; neighbours share a little more than that.
    assert found.waviness() == pytest.approx(0.5 * share * SIZE, rel=0.2)
    assert not found.strain(SIZE).is_strained


def test_a_wave_of_few_spacings_is_in_common_to_nearest_neighbours() -> None:
    # Six noises high and twenty spacings long: points next to each other on a curve through all stand up to five apart.
    points = cloud(1)
    ripple = 6.0 * NOISE * np.sin(6.0 * points[:, :1])
    found = between(points + ripple * [0.0, 1.0, 1.0], cloud(2)).waviness()
    assert found == pytest.approx(3.0 * NOISE, rel=0.2)


def test_a_motion_that_the_covariance_leaves_does_not_count() -> None:
    here, there = cloud(1) + np.array([0.02, 0.0, 0.0]), cloud(2)
    # No motion brings it nearer, where none is left by the pose: a quarter of the faces look along x.
    assert between(here, there).apart(SIZE, SURE) > FACES_APART_SHARE
    assert between(here, there).apart(SIZE, np.diag([0.0, 0.0, 0.0, 1e-2, 0.0, 0.0])) == 0.0
    assert between(here, there).apart(SIZE, np.diag([0.0, 0.0, 0.0, np.nan, 1e-2, 1e-2])) > FACES_APART_SHARE


def test_few_common_places_say_nothing() -> None:
    assert compared(cloud(1)[: MIN_COMPARISONS - 1], cloud(2)) is None
    assert compared(cloud(1) + 10.0, cloud(2)) is None


def test_a_cloud_and_its_pose_are_the_cloud_at_the_pose() -> None:
    # Fewer points than are asked about, so that both ways ask about all of them.
    T = twist.exp(np.array([0.3, -0.2, 0.5, 0.4, 0.1, -0.2]))
    one, other = cloud(1, count=1_500), cloud(2, count=1_500)
    there = between(one, other)
    back = compared(pose.apply(pose.inverse(T), one), other, T)
    assert back is not None
    order, same = (np.lexsort(found.points.round(9).T) for found in (there, back))
    np.testing.assert_allclose(back.points[same], there.points[order], atol=1e-12)
    np.testing.assert_allclose(back.residuals[same], there.residuals[order], atol=1e-12)
    np.testing.assert_allclose(back.noise[same], there.noise[order], atol=1e-12)


def trough(seed: int, upper: float) -> FloatArray:
    """Two faces of 30 x 30 that meet along z, one point to a unit of area, and two ledges of 30 x 2 across one."""
    rng = np.random.default_rng(seed)
    faces = [rng.uniform(0.0, 30.0, (count, 3)) for count in (900, 900, 60, 60)]
    faces[0][:, 1], faces[1][:, 0] = 0.0, 0.0
    for ledge, height in zip(faces[2:], (8.0, upper), strict=True):
        ledge[:, 1:] = ledge[:, 1:] * [2.0 / 30.0, 0.0] + [0.0, height]
    noises = (
        0.02 * rng.normal(size=(len(face), 1)) * np.eye(3)[k] for face, k in zip(faces, (1, 0, 2, 2), strict=True)
    )
    return np.vstack([face + noise for face, noise in zip(faces, noises, strict=True)])


def test_a_ledge_two_points_wide_is_compared() -> None:
    # Its points all stand by an edge, and the wide faces show no height: a ledge 15 noises off is all there is.
    same, moved = between(trough(1, 22.0), trough(2, 22.0)), between(trough(1, 22.3), trough(2, 22.0))
    for found in (same, moved):
        on_ledges = np.abs(found.normals[:, 2]) > np.cos(np.deg2rad(8.0))
        assert np.count_nonzero(on_ledges) > 20
        assert not np.any(on_ledges & found.inner)
    assert same.deformation(50.0) == 0.0 < moved.deformation(50.0)
    assert moved.on_no_edge.deformation(50.0) == 0.0


def test_a_wall_laid_on_its_other_side_lies_apart() -> None:
    # Two views of a ribbed plate: half of the ribs' sides are 1 apart, less than the points, and 20 times the noise.
    rng = np.random.default_rng(0)

    def seen(shift: float) -> FloatArray:
        flat, side, rib = (rng.uniform(0.0, 40.0, (900, 3)) for _ in range(3))
        flat[:, 2], side[:, 0], rib[:, 0] = 0.0, shift, 60.0
        return np.vstack([flat, side, rib]) + 0.05 * rng.normal(size=(2700, 3))

    here, there, slid = seen(0.0), seen(0.0), seen(1.0)
    assert between(here, there).apart(80.0, SURE) < 0.01
    assert between(here, slid).apart(80.0, SURE) > 0.2
