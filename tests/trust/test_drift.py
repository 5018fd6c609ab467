from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.morton import distinct_in_order
from dqreg.synth.parts import bracket
from dqreg.trust.strain import MIN_DRIFT_CORRESPONDENCES, Drift, drift_of
from tests.trust.shapes import box, plane

NOISE, SIZE = 0.003, 14.0**0.5


def swept(rotation: float, shift: float, make=box, *, seed: int = 0, noise: float = NOISE) -> Drift:
    """A box of 3 x 2 x 1, scanned in random order while it turned about z and moved along x."""
    rng = np.random.default_rng(seed)
    points, normals = make(rng, 3_000)
    order = distinct_in_order(points)
    points, normals, times = points[order], normals[order], rng.uniform(-0.5, 0.5, len(order))
    turn = np.cross([0.0, 0.0, rotation], points) + np.array([shift, 0.0, 0.0])
    residuals = times * np.einsum("ij,ij->i", turn, normals) + noise * rng.normal(size=len(points))
    return drift_of(points, normals, residuals, times)


@pytest.mark.parametrize(("rotation", "shift"), [(0.02, 0.0), (0.0, 0.05), (0.01, -0.1)])
def test_a_drift_is_found_with_its_size(rotation: float, shift: float) -> None:
    found = swept(rotation, shift)
    assert found.matters(SIZE)
    assert found.rotation_rad == pytest.approx(rotation, abs=1e-3)
    # Of a rotation about the middle, and a shift: 0.9 is the root mean square distance of the points from the axis.
    assert found.displacement == pytest.approx(np.hypot(shift, rotation * 1.35), rel=0.1)


@pytest.mark.parametrize("make", [box, plane])
def test_noise_does_not_drift(make) -> None:
    for seed in range(10):
        assert not swept(0.0, 0.0, make, seed=seed).matters(SIZE)


def test_a_small_drift_and_few_points_are_none() -> None:
    assert not swept(0.0, 0.002, noise=1e-5).matters(SIZE)
    few = np.ones((MIN_DRIFT_CORRESPONDENCES - 1, 3))
    assert drift_of(few, few, few[:, 0], few[:, 0]) == Drift()


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_a_part_that_moved_during_the_sweep_is_suspect(shift: float) -> None:
    part = Mesh(*bracket())
    rng = np.random.default_rng(0)
    points = sample_mesh(part, 6_000, rng).points + 0.05 * rng.normal(size=(6_000, 3))
    # In the order of the scan, by 2 % of the size in all.
    points[:, 0] += np.linspace(-0.5, 0.5, len(points)) * shift
    verdict = dqreg.register(points, part, "identity", effort="fast", search="never").verdict
    assert ("drift" in verdict.codes) == (shift > 0.0)
    assert (verdict.level == "accepted") == (shift == 0.0)


@pytest.mark.parametrize("shift", [0.0, 3.0])
def test_times_tell_a_drift_between_clouds_whatever_the_order_of_the_points(shift: float) -> None:
    part = Mesh(*bracket())
    rng = np.random.default_rng(1)
    points, times = sample_mesh(part, 4_000, rng).points, 1e9 + rng.uniform(0.0, 0.1, 4_000)
    target = sample_mesh(part, 6_000, rng).points + 0.05 * rng.normal(size=(6_000, 3))
    points = points + 0.05 * rng.normal(size=points.shape)
    # 2 % of the size along x from the first point to the last.
    points[:, 0] += shift * (times - times.min()) / np.ptp(times)
    verdict = dqreg.register(PointCloud(points, times=times), target, "identity", effort="fast", search="never").verdict
    told = {reason.code: reason for reason in verdict.reasons}
    assert ("drift" in told) == (shift > 0.0)
    # Within two degrees of x.
    assert not shift or "along (1.00, " in told["drift"]


def test_exact_data_have_no_scatter_to_divide_by() -> None:
    # Raised LinAlgError: of a scan without noise most points lie exactly on their faces, the others beside rounding.
    rng = np.random.default_rng(0)
    points, normals = box(rng, 3_000)
    residuals = np.where(rng.random(3_000) < 0.2, 3e-14, 0.0)
    assert not drift_of(points, normals, residuals, rng.uniform(-0.5, 0.5, 3_000)).matters(SIZE)
