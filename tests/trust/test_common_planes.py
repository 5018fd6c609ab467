"""Where the faces of two corners end: of one box, of two boxes, and of shapes that are more than a corner."""

from __future__ import annotations

import numpy as np
import pytest

from dqreg.trust import opposed_edges
from dqreg.trust.common_planes import CommonPlanes
from dqreg.trust.face_rims import Plane, shared_along
from dqreg.trust.limits import (
    FACE_OVERHANG_SHARE,
    ONE_PLANE_SHARE,
    OPPOSED_EDGE_SHARE,
    RIM_GAIN_SHARE,
    SHARED_RIM_SHARE,
)
from dqreg.trust.opposed_edges import Opposed
from dqreg.trust.overlap import IndexedPoints, Overlap
from tests.strategies import FloatArray
from tests.trust.shapes import sphere

SIZE, NOISE = 80.0, 0.02


def corner(edges: tuple[float, float, float], seed: int) -> FloatArray:
    """Points of the three faces that meet in the origin."""
    rng = np.random.default_rng(seed)
    faces = [np.delete(np.array(edges), k).prod() for k in range(3)]
    k = rng.choice(3, 3_000, p=np.array(faces) / sum(faces))
    points = rng.uniform(size=(3_000, 3)) * edges
    points[np.arange(3_000), k] = 0.0
    return points + NOISE * rng.normal(size=points.shape)


def ledge(height: float, seed: int) -> FloatArray:
    """Points of a face of 16 by 16 at a height over the first of those."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(250, 3)) * [0.0, 16.0, 16.0] + [height, 10.0, 10.0]
    return np.asarray(points + NOISE * rng.normal(size=points.shape))


def planes_of(one: FloatArray, other: FloatArray) -> CommonPlanes | None:
    sides, still = [IndexedPoints.of(points) for points in (one, other)], np.eye(4)
    overlap = Overlap.of(*sides, still)
    assert overlap is not None
    return CommonPlanes.of(overlap, *sides, still, SIZE)


def between(one: FloatArray, other: FloatArray) -> CommonPlanes:
    found = planes_of(one, other)
    assert found is not None
    return found


def said(one: FloatArray, other: FloatArray) -> float:
    return between(one, other).ends_apart()


def test_two_views_of_one_corner_end_together() -> None:
    assert said(corner((30.0, 40.0, 55.0), 1), corner((30.0, 40.0, 55.0), 2)) < 0.01


def test_the_corner_of_another_box_ends_elsewhere() -> None:
    assert said(corner((30.0, 40.0, 55.0), 1), corner((36.0, 34.0, 55.0), 2)) > FACE_OVERHANG_SHARE


def test_what_one_view_alone_shows_may_be_hidden_from_the_other() -> None:
    whole, part = corner((30.0, 40.0, 55.0), 1), corner((30.0, 40.0, 55.0), 2)
    assert said(whole, part[part[:, 2] < 35.0]) < 0.01


def test_rims_of_one_corner_are_shared_and_those_of_another_part_are_not() -> None:
    # The sides away from the corner, of which nothing is left out: half of each scan shows what the other does not.
    one, other = corner((30.0, 40.0, 55.0), 1), corner((30.0, 40.0, 55.0), 2)
    longer, wider = corner((45.0, 40.0, 30.0), 1), corner((30.0, 55.0, 42.0), 2)
    assert between(one, other).rims_shared() > 0.9
    assert between(longer, wider).rims_shared() < SHARED_RIM_SHARE
    assert between(one, other).largest < ONE_PLANE_SHARE


def test_a_face_that_lies_apart_in_both_is_no_plane_more_than_a_corner_has() -> None:
    # A ledge over one face, about a spacing higher in one scan: what looks its way there is one smooth surface of each.
    one, other = (
        np.concatenate([corner((30.0, 40.0, 55.0), seed), ledge(height, seed)])
        for seed, height in ((1, 12.0), (2, 13.2))
    )
    assert between(one, other).are_a_corner
    level = np.concatenate([corner((30.0, 40.0, 55.0), 2), ledge(12.0, 2)])
    assert len(between(one, level).planes) == 4


def test_both_sides_of_a_thin_wall_laid_on_each_other_are_told_by_the_rims_beside_it() -> None:
    # One scan shows the wall's inner side, 4 away from the outer one, and is slid so that the two are one plane.
    one, other = corner((30.0, 40.0, 55.0), 1), corner((30.0, 40.0, 55.0), 2)
    slid = other.copy()
    slid[np.abs(other[:, 0]) > 0.1, 0] += 4.0
    gained, slide = between(one, slid).rims_elsewhere(SIZE)
    assert gained > 2.0 * RIM_GAIN_SHARE
    assert slide == pytest.approx(4.0, abs=2.0)  # In steps in which rims are the same
    assert between(one, other).rims_elsewhere(SIZE)[0] < 0.5 * RIM_GAIN_SHARE


def test_a_rim_hidden_from_one_view_leaves_those_that_both_show() -> None:
    whole, part = corner((30.0, 40.0, 55.0), 1), corner((30.0, 40.0, 55.0), 2)
    assert between(whole, part[part[:, 2] < 35.0]).rims_shared() > SHARED_RIM_SHARE


def test_a_face_alone_is_one_plane() -> None:
    flat = corner((30.0, 40.0, 55.0), 1)
    top, again = (side[np.abs(side[:, 0]) < 0.1] for side in (flat, corner((30.0, 40.0, 55.0), 2)))
    assert between(top, again).largest > ONE_PLANE_SHARE


def test_planes_without_rims_share_none_wherever_they_are_slid() -> None:
    slides, shares = shared_along([None, None], [None, None], np.array([1.0, 0.0, 0.0]), SIZE)
    np.testing.assert_array_equal(slides, [0.0])
    assert np.isnan(shares).all()


def test_the_top_of_a_plate_laid_on_its_bottom_is_told_by_the_sides_below_and_above() -> None:
    one, other = corner((30.0, 40.0, 12.0), 1), corner((30.0, 40.0, 12.0), 2)
    upside_down = other * (1.0, 1.0, -1.0)  # Laid on the plane at height zero, its sides stand where the other's hang
    assert between(one, upside_down).opposed_edges() > 2.0 * OPPOSED_EDGE_SHARE
    assert between(upside_down, one).opposed_edges() > 2.0 * OPPOSED_EDGE_SHARE
    assert between(one, other).opposed_edges() < 0.1 * OPPOSED_EDGE_SHARE


@pytest.mark.parametrize("share", [0.0, 0.3, 0.6, 1.0])
def test_what_is_left_out_where_no_edges_can_be_opposed_is_opposed_nowhere(
    monkeypatch: pytest.MonkeyPatch, share: float
) -> None:
    # Of a box without its bottom, sides stand along a share of one edge and hang from the rest.
    rng = np.random.default_rng(5)
    one, other = corner((30.0, 40.0, 12.0), 1), corner((30.0, 40.0, 12.0), 2)
    hangs = (other[:, 1] > share * 40.0) | (rng.random(len(other)) < 0.02)
    other[hangs, 2] *= -1.0
    for pair in ((one, other), (other, one)):
        said_alone = between(*pair).opposed_edges()
        with monkeypatch.context() as patch:
            patch.setattr(opposed_edges, "_may_be_opposed", lambda *_: True)
            asked = between(*pair).opposed_edges()
        assert np.nan_to_num(asked) == said_alone


def test_planes_of_a_round_body_are_not_asked_for_opposed_edges_and_walls_are(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Plane] = []
    of = Opposed.of
    monkeypatch.setattr(Opposed, "of", lambda *given: asked.append(given[2]) or of(*given))
    ball, again = (SIZE / 2.0 * sphere(np.random.default_rng(seed), 3_000)[0] for seed in (1, 2))
    assert np.isnan(between(ball, again).opposed_edges())
    assert not asked
    walls = between(corner((30.0, 40.0, 55.0), 1), corner((30.0, 40.0, 55.0), 2))
    assert walls.opposed_edges() == 0.0
    # By the rims that are known, or by what stands beside the plane.
    assert {walls.planes.index(plane) for plane in asked} | set(walls._hardly_opposed) == {0, 1, 2}


def test_a_face_that_ends_at_nothing_opposes_none() -> None:
    one, other = (side[np.abs(side[:, 0]) < 0.1] for side in (corner((30.0, 40.0, 55.0), seed) for seed in (1, 2)))
    assert np.isnan(between(one, other).opposed_edges())


def test_a_box_of_six_planes_ends_like_itself_and_not_like_another_one() -> None:
    # A step on a block: five planes that both show; the other part is longer on one side, wider on the other.
    def stepped(edges: tuple[float, float, float], seed: int) -> FloatArray:
        low, rng = corner(edges, seed), np.random.default_rng(seed)
        step = corner((12.0, 15.0, 10.0), seed) + np.array([8.0, 9.0, 0.0])
        hidden = (np.abs(low[:, 2]) < 0.1) & (low[:, 0] > 8.0) & (low[:, 0] < 20.0) & (low[:, 1] > 9.0)
        return np.concatenate([low[~(hidden & (low[:, 1] < 24.0))], step[rng.permutation(len(step))[:1_500]]])

    one, same, other = stepped((45.0, 40.0, 30.0), 1), stepped((45.0, 40.0, 30.0), 2), stepped((30.0, 55.0, 42.0), 3)
    assert len(between(one, same).planes) > 3
    assert between(one, same).are_all
    assert not between(one, same).are_a_corner
    assert between(one, same).ends_apart() < 0.5 * FACE_OVERHANG_SHARE
    assert between(one, other).ends_apart() > 2.0 * FACE_OVERHANG_SHARE


def drilled(points: FloatArray, at: tuple[float, float], radius: float) -> FloatArray:
    """Without what lies in a hole of the face at height zero."""
    return points[(np.abs(points[:, 2]) > 0.1) | (np.linalg.norm(points[:, :2] - at, axis=1) > radius)]


def test_a_hole_of_one_face_that_the_other_closes_is_told_by_its_width() -> None:
    one, other = (drilled(corner((30.0, 40.0, 12.0), k), (15.0, 20.0), 6.0) for k in (1, 2))
    elsewhere, whole = drilled(corner((30.0, 40.0, 12.0), 2), (15.0, 30.0), 6.0), corner((30.0, 40.0, 12.0), 3)
    assert between(one, other).closed_hole(SIZE) == 0.0
    for wrong in (elsewhere, whole):
        # As wide as the free cells are, of two spacings of 0.6.
        assert between(one, wrong).closed_hole(SIZE) == pytest.approx(12.0, abs=2.4)
        assert between(wrong, one).closed_hole(SIZE) == pytest.approx(12.0, abs=2.4)


def test_what_stands_in_a_place_that_the_other_scan_does_not_see_is_no_closed_hole() -> None:
    # The shadow of a pin, which the second scan shows with the face around it.
    one, other = drilled(corner((30.0, 40.0, 12.0), 1), (15.0, 20.0), 6.0), corner((30.0, 40.0, 12.0), 2)
    pin = np.array([15.0, 20.0, 0.0]) + np.random.default_rng(3).uniform((-1, -1, 0), (1, 1, 9), (200, 3))
    assert between(one, np.concatenate([other, pin])).closed_hole(SIZE) == 0.0


def test_a_gap_amid_gaps_is_no_hole() -> None:
    # As beams and shadows leave them on the ground, which the second scan shows whole.
    one, other = corner((30.0, 40.0, 12.0), 1), corner((30.0, 40.0, 12.0), 2)
    crossed = one[(np.abs(one[:, 2]) > 0.1) | (one[:, :2] % 12.0 < 2.5).any(axis=1)]
    assert between(crossed, other).closed_hole(SIZE) == 0.0


def test_a_notch_in_the_border_is_no_hole() -> None:
    one, other = drilled(corner((30.0, 40.0, 12.0), 1), (30.0, 20.0), 6.0), corner((30.0, 40.0, 12.0), 2)
    assert between(one, other).closed_hole(SIZE) == 0.0


@pytest.mark.parametrize("seed", range(2))
def test_the_planes_of_a_ball_hold_little_of_it(seed: int) -> None:
    one, other = (1.0 * sphere(np.random.default_rng(k), 3_000)[0] for k in (seed, seed + 10))
    found = planes_of(one, other)
    assert found is None or not found.are_all
