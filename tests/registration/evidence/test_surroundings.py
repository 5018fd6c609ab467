"""What the points of a scan lie on: a block, a table beneath it, what stands apart, and more of the block itself."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, MeshSurface, PointCloud, prepare_scan, sample_mesh
from dqreg.icp import Correspondences, find_correspondences
from dqreg.registration.evidence.surroundings import Surroundings, displaced_of, surroundings_of
from dqreg.synth.parts import box

PART = Mesh(*box((100.0, 60.0, 40.0)))
LOW, HIGH = PART.bounds
NOISE = 0.02
WIDTH, NEAR = 4.0 * NOISE, 10.0


def block(size: tuple[float, float, float], at: FloatArray, count: int, seed: int) -> FloatArray:
    """Points of all sides but the lowest of a block, whose lowest corner is where it is said to be."""
    made, rng = Mesh(*box(size)), np.random.default_rng(seed)
    sampled = sample_mesh(Mesh(made.vertices - made.bounds[0] + at, made.faces), count, rng)
    above = sampled.points[:, 2] > at[2] + 1e-6
    return sampled.points[above] + NOISE * rng.normal(size=(int(above.sum()), 3))


def table(seed: int, count: int = 3_000) -> FloatArray:
    """Points of the plane that the part stands on, beside it."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform(LOW[:2] - 80.0, HIGH[:2] + 80.0, (count, 2))
    beside = ((flat < LOW[:2]) | (flat > HIGH[:2])).any(axis=1)
    points = np.column_stack([flat, np.full(count, LOW[2])])[beside]
    return points + NOISE * rng.normal(size=points.shape)


def matched(points: FloatArray, unit: float = 1.0) -> Correspondences:
    part = Mesh(unit * PART.vertices, PART.faces)
    return find_correspondences(prepare_scan(PointCloud(unit * points)), MeshSurface(part), np.eye(4))


def seen(points: FloatArray, unit: float = 1.0) -> tuple[Surroundings, Correspondences]:
    pairs = matched(points, unit)
    return surroundings_of(pairs, unit * WIDTH, unit * NEAR, unit * PART.diagonal), pairs


WHOLE = block((100.0, 60.0, 40.0), LOW, 3_000, 0)
# Half of the upper face: the other half says how the face lies.
RAISED = np.where((WHOLE[:, 2:] > HIGH[2] - 1.0) & (WHOLE[:, :1] > 0.5 * (LOW[0] + HIGH[0])), [0.0, 0.0, 2.0], 0.0)


def test_the_part_alone_is_all_on_the_target_and_nothing_else_is_asked() -> None:
    found, _ = seen(WHOLE)
    assert found.share_on > 0.99
    assert (found.share_other, found.share_contradicting) == (0.0, 0.0)
    assert not found.elsewhere.any()
    assert np.isnan(found.share_on_faces)


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_table_is_another_object_that_reaches_far(unit: float) -> None:
    points = np.concatenate([WHOLE, table(1)])
    found, pairs = seen(points, unit)
    assert found.share_contradicting == 0.0
    assert found.share_on == pytest.approx(len(WHOLE) / len(points), abs=0.03)
    assert found.share_on + found.share_other > 0.95
    assert found.share_on_faces <= found.share_on
    # Marked are points off the target, nearly all of the table and none of the part. The scan may be in another order.
    of_part = pairs.distances <= unit * WIDTH
    assert not (found.elsewhere & of_part).any()
    assert found.elsewhere[~of_part].mean() > 0.95


def test_an_object_that_stands_near_is_no_part_of_it_and_reaches_not_far() -> None:
    at = np.array([HIGH[0] + 1.0, LOW[1], LOW[2]])
    found, _ = seen(np.concatenate([WHOLE, block((6.0, 20.0, 20.0), at, 1_500, 2)]))
    assert found.share_other > 0.1
    assert not found.elsewhere.any()


def test_surface_of_the_part_itself_off_the_target_contradicts() -> None:
    longer = block((140.0, 60.0, 40.0), LOW, 4_000, 3)
    found, _ = seen(longer)
    assert found.share_contradicting > 0.2
    assert found.share_other < 0.05
    # What contradicts the pose is no other object, however far it reaches, but for points that are on no face.
    assert found.elsewhere.mean() < 0.02


def test_shares_are_of_all_points_and_add_up_to_no_more() -> None:
    for points in (WHOLE, np.concatenate([WHOLE, table(1)]), block((140.0, 60.0, 40.0), LOW, 4_000, 3)):
        found, _ = seen(points)
        assert 0.0 <= found.share_on + found.share_other + found.share_contradicting <= 1.0 + 1e-12


def displaced(points: FloatArray, unit: float = 1.0, ratio: float = 1.0) -> float:
    pairs = matched(points, unit)
    close = pairs.distances <= unit * NEAR
    return displaced_of(pairs, close, unit * WIDTH, unit * NOISE, pairs.surface, ratio)  # type: ignore[arg-type]


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_a_face_beside_its_place_is_displaced_and_one_that_is_there_is_not(unit: float) -> None:
    assert displaced(WHOLE, unit) == 0.0
    assert displaced(WHOLE + RAISED, unit) == pytest.approx((RAISED != 0.0).any(axis=1).mean(), rel=0.1)


def test_of_a_part_that_deviates_so_much_or_of_a_scene_none_is() -> None:
    assert displaced(WHOLE + RAISED, ratio=1e3) == 0.0
    assert displaced(np.concatenate([WHOLE + RAISED, table(1) * [3.0, 3.0, 1.0]])) == 0.0
    # Strays that lie anywhere are no face.
    rng = np.random.default_rng(4)
    strays = rng.uniform(LOW - 8.0, HIGH + 8.0, (300, 3))
    assert displaced(np.concatenate([WHOLE, strays])) < 0.02
