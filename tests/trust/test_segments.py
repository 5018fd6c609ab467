from __future__ import annotations

import numpy as np
import pytest

import dqreg
from dqreg.geometry import Mesh, MeshSurface, sample_mesh
from dqreg.rigid import pose
from dqreg.synth.parts import box
from dqreg.trust.segments import Segments, segments_of

PART = Mesh(*box((100.0, 60.0, 40.0)))
LOW, HIGH = PART.bounds
NOISE = 0.02


def faces(size: tuple[float, float, float], at: np.ndarray, count: int, seed: int) -> np.ndarray:
    """Points of the top and of four sides of a block, whose lowest corner is where it is said to be."""
    block = Mesh(*box(size))
    block = Mesh(block.vertices - block.bounds[0] + at, block.faces)
    rng = np.random.default_rng(seed)
    sampled = sample_mesh(block, count, rng)
    above = sampled.points[:, 2] > at[2] + 1e-6
    return sampled.points[above] + NOISE * rng.normal(size=(int(above.sum()), 3))


def table(seed: int, count: int = 4_000) -> np.ndarray:
    """Points around the part in the plane that it stands on."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform(LOW[:2] - 80.0, HIGH[:2] + 80.0, (count, 2))
    beside = ((flat < LOW[:2]) | (flat > HIGH[:2])).any(axis=1)
    points = np.column_stack([flat, np.full(count, LOW[2])])[beside]
    return points + NOISE * rng.normal(size=points.shape)


def seen(points: np.ndarray, size: float = PART.diagonal) -> Segments:
    closest = MeshSurface(PART).closest(points)
    return segments_of(points, closest.normals, closest.distances, 4.0 * NOISE, size)


def test_the_part_itself_is_on_the_target() -> None:
    found = seen(faces((100.0, 60.0, 40.0), LOW, 5_000, 0))
    assert found.on.mean() >= 0.99
    assert not found.contradicting.any()
    assert not found.other.any()


@pytest.mark.parametrize("high", [15.0, 70.0])
def test_a_table_and_a_clamp_that_touch_the_part_are_other_objects(high: float) -> None:
    part = faces((100.0, 60.0, 40.0), LOW, 4_000, 1)
    clamp = faces((40.0, 20.0, high), np.array([HIGH[0], LOW[1] + 15.0, LOW[2]]), 1_500, 2)
    clamp = clamp[clamp[:, 0] > HIGH[0] + 1e-6]
    part = part[~((np.abs(part[:, 0] - HIGH[0]) < 1.0) & (np.abs(part[:, 1] - LOW[1] - 25.0) < 10.0))]
    found = seen(np.vstack([part, clamp, table(3)]))
    assert found.contradicting.mean() <= 0.01
    assert found.other[len(part) :].mean() >= 0.8


def test_a_table_under_a_plate_thinner_than_the_points_stand_apart_is_another_object() -> None:
    """Links between the points then lead down from the plate; a face that goes on beyond it is of the same body."""
    plate = Mesh(*box((100.0, 60.0, 1.0)))
    low, high = plate.bounds
    rng = np.random.default_rng(5)
    flat = rng.uniform(low[:2] - 80.0, high[:2] + 80.0, (2_000, 2))
    above = ((flat > low[:2]) & (flat < high[:2])).all(axis=1)
    points = np.column_stack([flat, np.where(above, high[2], low[2])])
    points += NOISE * rng.normal(size=points.shape)
    goes_on = points.copy()
    goes_on[:, 2] = high[2] + NOISE * rng.normal(size=len(points))
    for scan, contradicts in ((points, False), (goes_on, True)):
        closest = MeshSurface(plate).closest(scan)
        found = segments_of(scan, closest.normals, closest.distances, 4.0 * NOISE, plate.diagonal)
        assert (found.contradicting[~above].mean() > 0.8) == contradicts
        assert (found.other[~above].mean() > 0.8) != contradicts


def test_a_larger_block_on_a_corner_continues_beyond_the_part() -> None:
    found = seen(faces((180.0, 60.0, 40.0), LOW, 5_000, 4))
    beyond = 0.5 * np.mean(found.on)
    assert found.contradicting.mean() >= beyond
    assert found.other.mean() <= 0.1


def test_a_face_that_meets_the_part_in_a_convex_edge_is_not_another_object() -> None:
    # A longer block seen end on: its top is on the part's, its end hangs in the air.
    points = faces((100.0, 60.0, 40.0), LOW, 5_000, 5)
    tilted = points[(np.abs(points[:, 2] - HIGH[2]) < 1.0) | (np.abs(points[:, 0] - HIGH[0]) < 1.0)]
    end = np.abs(tilted[:, 0] - HIGH[0]) < 1.0
    lean = tilted.copy()
    lean[end, 0] -= HIGH[2] - tilted[end, 2]
    found = seen(lean)
    # Points along its edges belong to no segment.
    assert found.contradicting[end].mean() >= 0.5
    assert not found.contradicting[~end].any()
    # It is 60 wide: no face of a part with a diagonal of 50, whatever edge it meets that in.
    assert seen(lean, 50.0).other[end].mean() >= 0.5


@pytest.mark.parametrize(("below", "contradicts"), [(3.0, False), (0.0, True)])
def test_a_face_that_goes_on_beyond_the_rim_of_another_meets_it_in_no_edge(below: float, contradicts: bool) -> None:
    """A slope beside the part, whose plane lies below the rim of its top or begins at it: seen from above both fit."""
    rng = np.random.default_rng(6)
    top = np.column_stack([rng.uniform(LOW[:2], HIGH[:2], (6_000, 2)), np.full(6_000, HIGH[2])])
    # Down from beyond the rim; the one that lies lower rises above the plane of the top farther on.
    along, across = rng.uniform(0.0, 60.0, 4_000), rng.uniform(LOW[1], HIGH[1], 4_000)
    angle = np.deg2rad(50.0)
    slope = np.column_stack([HIGH[0] + along * np.cos(angle), across, HIGH[2] - below + along * np.sin(angle)])
    if contradicts:
        slope[:, 2] = HIGH[2] - along * np.sin(angle)
    scan = np.vstack([top, slope]) + NOISE * rng.normal(size=(10_000, 3))
    found = seen(scan)
    assert (found.contradicting[6_000:].mean() > 0.8) == contradicts


def test_the_end_of_a_block_that_is_a_little_longer_is_of_the_same_body() -> None:
    # Its sides run on beyond the target by a few spacings only; its end hangs in the air.
    points = faces((114.0, 60.0, 40.0), LOW, 5_000, 12)
    end = points[:, 0] > HIGH[0] + 14.0 - 5.0 * NOISE
    found = seen(points)
    assert found.contradicting[end].mean() >= 0.5
    assert not found.contradicting[points[:, 0] < HIGH[0] - 1.0].any()


def test_shares_follow_no_unit_and_no_rigid_motion() -> None:
    points = np.vstack([faces((140.0, 60.0, 40.0), LOW, 3_000, 6), table(7, 2_000)])
    plain = seen(points)
    T = pose.random(np.random.default_rng(8), reach=300.0)
    moved = Mesh(1e3 * pose.apply(T, PART.vertices), PART.faces)
    closest = MeshSurface(moved).closest(1e3 * pose.apply(T, points))
    again = segments_of(1e3 * pose.apply(T, points), closest.normals, closest.distances, 4e3 * NOISE)
    for name in ("on", "contradicting", "other"):
        assert getattr(again, name).mean() == pytest.approx(getattr(plain, name).mean(), abs=0.01)


def test_a_larger_block_is_suspect_and_a_part_on_a_table_is_accepted() -> None:
    part = faces((100.0, 60.0, 40.0), LOW, 4_000, 9)
    on_table = dqreg.register(np.vstack([part, table(10)]), PART, "identity", effort="fast")
    assert on_table.verdict.level == "accepted"
    block = faces((160.0, 60.0, 40.0), LOW, 6_000, 11)
    longer = dqreg.register(block, PART, "identity", effort="fast", search="never")
    assert longer.verdict.level == "suspect"
    assert "contradicting_surface" in longer.verdict.codes
    alone = dqreg.register(np.vstack([part, table(10)]), PART, "identity", effort="fast", clutter="none")
    assert alone.verdict.codes == ("clutter",)


def test_a_table_that_shows_beneath_a_part_too_long_is_none_of_its_faces() -> None:
    """The scanned block is 12 shorter than the target and shows no end: rows of the table lie on the target there."""
    short = faces((88.0, 60.0, 40.0), LOW, 700, 1)
    short = short[short[:, 0] < LOW[0] + 87.0]
    around, shown = table(3, 4_000), table(4, 20_000)
    rng = np.random.default_rng(5)
    strip = np.column_stack(
        [rng.uniform(88.0, 100.0, 50) + LOW[0], rng.uniform(LOW[1], HIGH[1], 50), np.full(50, LOW[2])]
    )
    found = seen(np.vstack([short, around, strip]))
    assert found.contradicting[len(short) :].mean() >= 0.8
    # Where nothing of it lies on the target, the table is another object, however dense its rim.
    found = seen(np.vstack([short, shown]))
    assert found.contradicting.mean() <= 0.01
