"""Whether a part passes: places, regions and shares, each against a part whose fault is known because it was made."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import Decision, Deviations, Tolerance, decide, measure_deviations
from dqreg.synth.parts import box

NOISE, TOLERANCE = 0.01, 0.1
HALF = 20.0


def top(count: int = 20_000, seed: int = 0) -> np.ndarray:
    """Points of the upper and the right side of a cube of 40 about the origin, with noise along their normals."""
    rng = np.random.default_rng(seed)
    up = np.column_stack([rng.uniform(-HALF, HALF, (count, 2)), HALF + rng.normal(0.0, NOISE, count)])
    right = np.column_stack([HALF + rng.normal(0.0, NOISE, count // 2), rng.uniform(-HALF, HALF, (count // 2, 2))])
    return np.vstack([up, right])


def deviations(points: np.ndarray, sigma: float = 0.0, noise: float | None = NOISE) -> Deviations:
    """Deviations from the cube; the pose's translation is known to `sigma` along each axis."""
    mesh = Mesh(*box((2 * HALF,) * 3))
    mesh = Mesh(mesh.vertices - mesh.centre, mesh.faces)
    covariance = np.diag([0.0] * 3 + [sigma**2] * 3)
    return measure_deviations(points, mesh, MeshSurface(mesh), reach=2.0, noise=noise, covariance=covariance)


def bumped(height: float, radius: float = 2.0) -> np.ndarray:
    points = top()
    points[(np.linalg.norm(points[:, :2], axis=1) < radius) & (points[:, 2] > HALF - 1.0), 2] += height
    return points


def names(found: Decision) -> dict[str, str | None]:
    return {region.name: region.outcome for region in found.regions}


def test_a_good_part_passes_everywhere() -> None:
    found = decide(deviations(top()), TOLERANCE, required_share=1.0)
    assert found.outcome == "pass"
    assert not found.places
    assert names(found) == {"flat face towards +z": "pass", "flat face towards +x": "pass"}


def test_how_much_of_the_part_was_scanned_is_known() -> None:
    # Two of six sides of the cube; then half of the upper one, and a margin of twice the spacing of 0.28.
    assert decide(deviations(top()), TOLERANCE).scanned == pytest.approx(2 / 6, abs=0.002)
    points = top()
    half = points[(points[:, 2] > HALF - 1.0) & (points[:, 0] < 0.0)]
    assert decide(deviations(half), TOLERANCE).scanned == pytest.approx((0.5 + 0.57 / 40) / 6, abs=0.002)


@pytest.mark.parametrize("height", [0.3, -0.3])
def test_a_bump_fails_though_the_share_passes(height: float) -> None:
    # The bump covers 0.8 % of the face.
    found = decide(deviations(bumped(height)), TOLERANCE)
    assert (found.outcome, found.share) == ("fail", "pass")
    assert found.places[0].value == pytest.approx(height, abs=NOISE)
    assert np.linalg.norm(found.places[0].position[:2]) < 2.0
    assert names(found) == {"flat face towards +z": "fail", "flat face towards +x": "pass"}


def test_single_points_are_forgiven_however_far() -> None:
    points = top()
    rows = np.random.default_rng(1).choice(len(points), 200, replace=False)
    points[rows] *= 1.03
    found = decide(deviations(points), TOLERANCE)
    assert found.outcome == "pass"
    assert not found.places


@pytest.mark.parametrize("required", [0.8, 0.95, 0.99, 1.0])
def test_noise_alone_proves_no_fault_and_no_pass(required: float) -> None:
    # Noise as large as the tolerance: a third of the points are out, their medians are not.
    points = top()
    points += np.random.default_rng(2).normal(0.0, TOLERANCE, points.shape)
    found = decide(deviations(points, noise=TOLERANCE), TOLERANCE, required)
    assert found.share_within == pytest.approx(0.68, abs=0.01)
    assert (found.share, found.outcome) == ("undecided", "undecided")
    assert set(names(found).values()) == {"undecided"}


def test_the_noise_of_one_face_is_its_own() -> None:
    # One of two faces was scanned at a grazing angle, with ten times the noise: a third of its points are out.
    points = top()
    points[20_000:, 0] += np.random.default_rng(2).normal(0.0, TOLERANCE, 10_000)
    found = decide(deviations(points), TOLERANCE)
    assert found.outcome == "undecided"
    assert names(found) == {"flat face towards +z": "pass", "flat face towards +x": "undecided"}


def test_more_points_out_than_noise_explains_fail_without_a_place() -> None:
    # One point in ten, none of them together: chips of 0.2 on noise of 0.01, where 0.1 is allowed.
    points = top()
    points[::10] += 0.2
    found = decide(deviations(points, noise=None), TOLERANCE)
    assert (found.share, found.outcome) == ("fail", "fail")
    assert not [place for place in found.places if place.outcome == "fail"]


def test_within_the_uncertainty_nothing_is_proven() -> None:
    # The face stands 0.09 off: certain to 0.001 that is a pass, certain to 0.02 (k = 2) it is neither.
    points = top()
    points[points[:, 2] > HALF - 1.0, 2] += 0.07
    assert decide(deviations(points, 0.0005), TOLERANCE).outcome == "pass"
    found = decide(deviations(points, 0.02), TOLERANCE)
    assert found.outcome == "undecided"
    assert found.uncertainty == pytest.approx(0.04)
    points[points[:, 2] > HALF - 1.0, 2] += 0.2
    assert decide(deviations(points, 0.02), TOLERANCE).outcome == "fail"


def test_a_motion_that_is_free_adds_nothing() -> None:
    found = deviations(top())
    free = np.zeros((6, 6))
    free[1, :] = free[:, 1] = np.nan
    assert decide(dataclasses.replace(found, covariance=free), TOLERANCE).uncertainty == 0.0


def test_a_larger_tolerance_is_never_worse() -> None:
    found = deviations(bumped(0.3), 0.01)
    order = ("fail", "undecided", "pass")
    ranks = [
        order.index(decide(found, tolerance).outcome) for tolerance in (0.05, 0.1, 0.2, 0.27, 0.31, 0.35, 0.5, 1.0)
    ]
    assert ranks == sorted(ranks)
    assert (ranks[0], ranks[-1]) == (0, 2)


def test_a_probe_of_few_points_is_judged_by_each() -> None:
    points = top(60)[:60]
    points[7, 2] = HALF + 0.3
    found = decide(deviations(points), TOLERANCE)
    assert found.outcome == "fail"
    assert [round(place.value, 9) for place in found.places] == [0.3]


def test_a_share_is_undecided_where_the_pose_decides_it() -> None:
    # Of noise of half the tolerance 95.4 % are within; the pose may shift that to 89 or 98 %. No place is near a limit.
    found = deviations(top(), 0.2 * NOISE)
    made = decide(found, 2.0 * NOISE)
    assert not made.places
    assert made.share_within == pytest.approx(0.954, abs=0.004)
    assert (made.share, made.outcome) == ("undecided", "undecided")
    shares = {required: decide(found, 2.0 * NOISE, required).share for required in (0.88, 0.97, 0.99)}
    assert shares == {0.88: "pass", 0.97: "undecided", 0.99: "undecided"}


def test_the_uncertainty_of_a_place_is_that_of_pose_and_median() -> None:
    found = decide(deviations(bumped(0.3), 0.003), TOLERANCE)
    # The median of 25 points scatters by 1.2533 / 5 of their noise, which the 25 themselves tell to a quarter.
    median, pose = 1.2533 * NOISE / 5.0, 0.003
    assert found.places[0].uncertainty == pytest.approx(2.0 * np.hypot(median, pose), rel=0.15)
    alone = decide(deviations(bumped(0.3)), TOLERANCE).places[0]
    assert alone.uncertainty == pytest.approx(2.0 * median, rel=0.5)


def test_what_cannot_be_decided_is_named() -> None:
    found = deviations(top(100))
    with pytest.raises(InputError, match="needs a tolerance"):
        decide(found)
    with pytest.raises(InputError, match="required_share must be above 0"):
        decide(found, 0.1, required_share=95.0)


def test_sides_of_a_tolerance_count_for_themselves() -> None:
    # The upper face stands 0.07 off, with noise of 0.01.
    points = top()
    points[points[:, 2] > HALF - 1.0, 2] += 0.07
    found = deviations(points, 0.0005)
    limits = {(-0.03, 0.11): "pass", (-0.2, 0.03): "fail", (0.03, 0.2): "fail"}
    assert {ends: decide(found, Tolerance(*ends)).outcome for ends in limits} == limits
    assert decide(found, Tolerance(-0.1, 0.1)).outcome == decide(found, 0.1).outcome == "pass"


def test_a_face_has_its_own_tolerance_and_share() -> None:
    found = deviations(bumped(0.3))
    (up,) = (region.number for region in decide(found, TOLERANCE).regions if region.outcome == "fail")
    wide = decide(found, TOLERANCE, faces={up: Tolerance(-0.1, 0.4)})
    assert (wide.outcome, wide.own, wide.tolerance, wide.low, wide.high) == ("pass", 1, 0.4, -0.1, 0.1)
    assert {region.number: region.high for region in wide.regions}[up] == 0.4
    # Alone, it is all that is asked: the share is of its points.
    alone = decide(found, faces={up: TOLERANCE})
    assert alone.outcome == "fail"
    assert [region.outcome for region in alone.regions] == ["fail", None]
    assert alone.share_within == pytest.approx(0.992, abs=2e-3)
    # Chips at an eighth of the points: a required share of its own forgives that.
    points = top()
    points[:20_000:8, 2] += 0.2
    noisy = deviations(points, noise=None)
    assert decide(noisy, TOLERANCE, 0.6, {up: Tolerance(-0.1, 0.1, 0.95)}).outcome == "fail"
    eased = decide(noisy, TOLERANCE, 0.6, {up: Tolerance(-0.1, 0.1, 0.6)})
    assert not [place for place in eased.places if place.outcome == "fail"]
    assert eased.share == "pass"


def test_tolerances_that_cannot_be_held_are_named() -> None:
    found = deviations(top(400))
    with pytest.raises(InputError, match=r"tolerance of 2 .*is not below the reach of 2"):
        decide(found, 2.0)
    with pytest.raises(InputError, match="has no face 17; its faces are 0 to 5"):
        decide(found, 0.1, faces={17: 0.1})
    with pytest.raises(InputError, match="need signs"):
        decide(dataclasses.replace(found, signed=False), Tolerance(0.0, 0.1))
    with pytest.raises(InputError, match="low < high"):
        Tolerance(0.1, -0.1)


def test_strays_beyond_an_edge_do_not_bring_in_what_the_pose_does_not_hold() -> None:
    # Upper and right side alone hold nothing along y; noise lays points of their rims on the sides across y.
    points = top()
    beyond = np.flatnonzero(HALF - np.abs(points[:, 1]) < 0.002)
    points[beyond, 1] = np.sign(points[beyond, 1]) * (HALF + 0.02)
    found = deviations(points)
    found = dataclasses.replace(found, covariance=np.diag([0.0] * 4 + [1.0, 0.0]))
    assert 1 <= np.count_nonzero(found.pose_sigma(np.flatnonzero(found.counted)) > 0.5) < 25
    judged = decide(found, TOLERANCE)
    assert (judged.outcome, judged.places) == ("pass", ())
    assert judged.uncertainty < TOLERANCE
    # Of a side that was scanned it counts.
    left = np.column_stack([points[:5_000, 0], np.full(5_000, HALF), points[:5_000, 1]])
    both = dataclasses.replace(deviations(np.vstack([points, left])), covariance=found.covariance)
    assert decide(both, TOLERANCE).outcome == "undecided"
    assert decide(both, TOLERANCE).uncertainty == pytest.approx(2.0, rel=1e-6)
