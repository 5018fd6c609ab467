"""What a scan's points belong to, against scenes whose answer is known because they were made so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import Deviations, decide, measure_deviations
from dqreg.inspection.membership.membership import BEYOND, EXCLUDED, ON_PART, OTHER_SURFACE, OUTLIER, in_boxes
from dqreg.synth.parts import angle, box

NOISE, REACH = 0.02, 4.0
SIZE = (40.0, 30.0, 10.0)


def sides(rng: np.random.Generator, count: int) -> np.ndarray:
    """Points of the top and of one side of a box of `SIZE` from the origin, and their bump of 1 mm in the middle."""
    top = np.column_stack([rng.uniform(0, [40, 30], (count, 2)), np.full(count, 10.0)])
    side = np.column_stack([np.zeros(count // 4), rng.uniform(0, [30, 10], (count // 4, 2))])
    top[np.linalg.norm(top[:, :2] - [20, 15], axis=1) < 3.0, 2] += 1.0
    return np.vstack([top, side])


def scene() -> tuple[np.ndarray, np.ndarray]:
    """A block on a table with outliers: points, and what each is."""
    rng = np.random.default_rng(3)
    part = sides(rng, 12_000)
    table = np.column_stack([rng.uniform([-30, -30], [0, 60], (30_000, 2)), np.zeros(30_000)])
    stray = rng.uniform([-30, -30, 12], [70, 60, 60], (300, 3))
    points = np.vstack([part, table, stray])
    kinds = np.repeat([0, 1, 2], [len(part), len(table), len(stray)])
    return points + rng.normal(0.0, NOISE, points.shape), kinds


def measured(points: np.ndarray, **options: object) -> Deviations:
    mesh = Mesh(*box(SIZE))
    mesh = Mesh(mesh.vertices - mesh.bounds[0], mesh.faces)
    defaults = {"reach": REACH, "noise": NOISE, "spacing": 0.2}
    return measure_deviations(points, mesh, MeshSurface(mesh), **(defaults | options))  # type: ignore[arg-type]


def test_a_table_is_left_out_and_a_bump_is_not() -> None:
    points, kinds = scene()
    flags = measured(points).flags
    # Beside the table, points of the part beyond three sigmas go with it: 0.3 % of those within two cells.
    assert (flags[kinds == 0] == ON_PART).mean() > 0.999
    # What is left of the table touches the part: within two cells of the edge, 2 x 3 spacings.
    left = points[(kinds == 1) & (flags == ON_PART)]
    assert np.abs(left[:, 0]).max(initial=0.0) < 1.2
    assert not (flags[kinds == 2] == ON_PART).any()
    assert {OTHER_SURFACE, OUTLIER, BEYOND} <= set(flags)


def test_the_counts_add_up_and_the_figures_are_of_the_part() -> None:
    points, _ = scene()
    found = measured(points, exclude=[(15, 10, 5, 25, 20, 15)])
    counts = dataclasses.asdict(found.counts)
    assert counts.pop("total") == len(points) == sum(counts.values())
    assert found.counts.excluded == np.count_nonzero(found.flags == EXCLUDED) > 0
    assert found.summary().count == found.counts.on_part
    # With the bump's box left out, nothing on the part lies farther than the table's foot.
    assert found.summary().p99 < 4.0 * NOISE


def test_another_unit_and_place_belong_alike() -> None:
    points, _ = scene()
    mesh = Mesh(*box(SIZE))
    mesh = Mesh((mesh.vertices - mesh.bounds[0]) * 1e-3, mesh.faces)
    small = measure_deviations(
        points * 1e-3, mesh, MeshSurface(mesh), reach=REACH * 1e-3, noise=NOISE * 1e-3, spacing=0.2e-3
    )
    assert np.mean(small.flags != measured(points).flags) < 1e-3


def test_without_noise_or_limit_distance_alone_decides() -> None:
    points, _ = scene()
    kept = measured(points, noise=None)
    np.testing.assert_array_equal(kept.counted, np.abs(kept.values) <= REACH)
    assert measured(points, reach=np.inf).counted.all()


@pytest.mark.parametrize("box", [(1, 2, 3), (0, 0, 0, 1, 1, np.nan), "corner"])
def test_a_box_that_is_none_is_refused(box: object) -> None:
    with pytest.raises(InputError, match=r"six coordinates|real numbers"):
        in_boxes(np.zeros((2, 3)), [box])  # type: ignore[list-item]


def found(points: np.ndarray, **options: object) -> Deviations:
    return measured(points, reach=None, limit=REACH, **options)


def top(rng: np.random.Generator, count: int = 12_000) -> np.ndarray:
    """Points of the top of the box."""
    return np.column_stack([rng.uniform(0, [40, 30], (count, 2)), np.full(count, 10.0)])


def on_table(rng: np.random.Generator, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part and a table beside it, with noise; and which points are the part's."""
    table = np.column_stack([rng.uniform([-30, -30], [0, 60], (30_000, 2)), np.zeros(30_000)])
    points = np.vstack([part, table])
    return points + rng.normal(0.0, NOISE, points.shape), np.arange(len(points)) < len(part)


def test_the_reach_is_as_far_as_the_part_goes_and_says_what_it_follows_from() -> None:
    points, kinds = (each[::2] for each in scene())
    deviating = found(points)
    assert deviating.reach_from == "deviations"
    # The bump is 1 mm high; noise adds a few sigmas.
    assert 1.0 < deviating.reach < 1.0 + 6.0 * NOISE
    assert np.abs(deviating.values[deviating.counted]).max() == deviating.reach
    assert (deviating.flags[np.abs(deviating.values) > deviating.reach] == BEYOND).all()
    flat = points[(kinds != 0) | (np.linalg.norm(points[:, :2] - [20, 15], axis=1) > 3.5)]
    assert (found(flat).reach, found(flat).reach_from) == (pytest.approx(0.2), "spacing")
    assert (found(flat, spacing=0.1).reach, found(flat, spacing=0.1).reach_from) == (pytest.approx(6 * NOISE), "noise")
    assert (measured(points).reach, measured(points).reach_from) == (REACH, "given")
    assert (found(points, noise=None).reach, found(points, noise=None).reach_from) == (REACH, "size")


def test_a_tolerance_above_the_reach_that_was_found_is_one_the_part_keeps() -> None:
    rng = np.random.default_rng(0)
    points, _ = on_table(rng, top(rng))
    assert decide(found(points), 1.0).outcome == "pass"
    with pytest.raises(InputError, match="not below the reach"):
        decide(found(points), 2.0 * REACH)


@pytest.mark.parametrize("sagitta", [3.0, 5.0])
def test_a_part_bent_beyond_the_limit_is_measured_whole(sagitta: float) -> None:
    rng = np.random.default_rng(1)
    part = top(rng)
    part[:, 2] += sagitta * (part[:, 0] / 40.0) ** 2
    points, own = on_table(rng, part)
    bent = found(points)
    assert (bent.flags[own] == ON_PART).mean() > 0.99
    assert bent.reach > 0.95 * sagitta
    assert not (bent.flags[~own & (points[:, 0] < -1.2)] == ON_PART).any()


def test_a_wall_out_of_place_that_stands_on_a_table_is_the_part_s() -> None:
    rng = np.random.default_rng(2)
    wall = np.column_stack([np.full(8_000, -1.5), rng.uniform(0, [30, 10], (8_000, 2))])
    points, own = on_table(rng, np.vstack([top(rng), wall]))
    thick = found(points)
    # Within two cells of the table a point may go with it.
    assert (thick.flags[own & (points[:, 2] > 1.2)] == ON_PART).mean() > 0.99
    assert decide(thick, 0.5).places[0].value == pytest.approx(1.5, abs=3 * NOISE)
    assert not (thick.flags[~own & (points[:, 0] < -3.5)] == ON_PART).any()


def test_a_face_beyond_the_limit_counts_where_it_was_not_measured_otherwise_and_a_pad_before_it_does_not() -> None:
    rng = np.random.default_rng(4)
    side = np.column_stack([np.zeros(4_000), rng.uniform(0, [30, 10], (4_000, 2))])
    raised = top(rng) + np.array([0.0, 0.0, 6.0])
    thick = found(np.vstack([raised, side]) + rng.normal(0.0, NOISE, (16_000, 3)))
    assert (thick.flags[:12_000] == ON_PART).all()
    pad = np.column_stack([rng.uniform([10, 10], [20, 20], (3_000, 2)), np.full(3_000, 12.0)])
    held = found(np.vstack([pad, top(rng, 24_000)]) + rng.normal(0.0, NOISE, (27_000, 3)))
    assert not (held.flags[:3_000] == ON_PART).any()
    assert (held.flags[3_000:] == ON_PART).all()


def test_spikes_are_forgiven_and_a_patch_as_high_is_not() -> None:
    rng = np.random.default_rng(5)
    flat = top(rng)
    flat[:, 2] += rng.normal(0.0, NOISE, len(flat))
    # Lower than one spacing, so that no cell of their own tells them from the surface.
    high = rng.choice(len(flat), 840, replace=False)
    spiky = flat.copy()
    spiky[high, 2] += 0.18
    forgiven = found(spiky)
    # Five that happen to lie together are a patch.
    assert (forgiven.flags[high] != ON_PART).mean() > 0.95
    assert (np.delete(forgiven.flags, high) == ON_PART).mean() > 0.999
    assert decide(forgiven, 0.1).outcome == "pass"
    # Twice as wide as the neighbourhood that is asked.
    patch = np.linalg.norm(flat[:, :2] - [20, 15], axis=1) < 1.3
    assert patch.sum() > 50
    flat[patch, 2] += 0.18
    kept = found(flat)
    # At its rim points may stand alone.
    assert (kept.flags[patch] == ON_PART).mean() > 0.8
    assert decide(kept, 0.1).outcome == "fail"


def test_a_raised_floor_beside_a_wall_is_measured_though_some_of_it_is_nearer_to_the_wall() -> None:
    rng = np.random.default_rng(6)
    mesh = Mesh(*angle(length=20.0, height=30.0, width=30.0, bend_radius=0.5, large_hole=3.0, small_hole=2.0))
    floor = np.column_stack([rng.uniform([2.5, 0], [20, 30], (12_000, 2)), np.full(12_000, 2.0 + 5.0)])
    wall = np.column_stack([np.full(8_000, 2.0), rng.uniform([0, 7], [30, 30], (8_000, 2))])
    points = np.vstack([floor, wall]) + rng.normal(0.0, NOISE, (20_000, 3))
    raised = measure_deviations(points, mesh, MeshSurface(mesh), limit=REACH, noise=NOISE, spacing=0.2)
    assert (raised.flags[:12_000] == ON_PART).mean() > 0.99


def plate(bore: float, missing: tuple[int, int] = (1, 1)) -> Mesh:
    """A plate of 80 x 80 x 20 from the origin with a square bore in its middle, or one of its corners missing."""
    x = np.array([0.0, 40 - bore / 2, 40 + bore / 2, 80.0])
    cells = [(i, j) for i in range(3) for j in range(3)]
    at = {(i, j, k): (i * 4 + j) * 2 + k for i in range(4) for j in range(4) for k in range(2)}
    corners = np.array([[x[i], x[j], 20.0 * k] for i in range(4) for j in range(4) for k in range(2)])
    quads = []
    for i, j in cells:
        if (i, j) == missing:
            continue
        quads += [[(i, j, 1), (i + 1, j, 1), (i + 1, j + 1, 1), (i, j + 1, 1)]]
        quads += [[(i, j, 0), (i, j + 1, 0), (i + 1, j + 1, 0), (i + 1, j, 0)]]
        for one, two, beside in (
            ((i, j), (i + 1, j), (i, j - 1)),
            ((i + 1, j), (i + 1, j + 1), (i + 1, j)),
            ((i + 1, j + 1), (i, j + 1), (i, j + 1)),
            ((i, j + 1), (i, j), (i - 1, j)),
        ):
            if beside == missing or beside not in cells:
                quads += [[(*one, 0), (*two, 0), (*two, 1), (*one, 1)]]
    rows = [[at[corner] for corner in quad] for quad in quads]
    return Mesh(corners, np.array([half for a, b, c, d in rows for half in ((a, b, c), (a, c, d))]))


def on_plate(
    bore: float, more: np.ndarray, *, closed: bool, missing: tuple[int, int] = (1, 1), table: bool = True
) -> Deviations:
    """Deviations of the top of the plate and of the table that it stands on, with the bore open or closed, and more."""
    rng = np.random.default_rng(7)
    upper = np.column_stack([rng.uniform(0, 80, (40_000, 2)), np.full(40_000, 20.0)])
    if not closed:
        at = np.searchsorted([40 - bore / 2, 40 + bore / 2], upper[:, :2])
        upper = upper[(at != missing).any(axis=1)]
    under = np.column_stack([rng.uniform(-40, 120, (60_000, 2)), np.zeros(60_000)])
    under = under[((under[:, :2] < 0) | (under[:, :2] > 80)).any(axis=1)]
    points = np.vstack([more, upper, under[: len(under) * table]])
    points += rng.normal(0.0, NOISE, points.shape)
    mesh = plate(bore, missing)
    return measure_deviations(points, mesh, MeshSurface(mesh), limit=REACH, noise=NOISE, spacing=0.4)


@pytest.mark.parametrize(
    "bore", [4.0, 12.0, 30.0, *(pytest.param(bore, marks=pytest.mark.soak) for bore in (7.0, 20.0))]
)
def test_a_bore_that_was_not_made_fails_and_one_that_was_passes(bore: float) -> None:
    none = np.zeros((0, 3))
    assert decide(on_plate(bore, none, closed=False), 0.2).outcome == "pass"
    shut = on_plate(bore, none, closed=True)
    inside = (np.abs(shut.points - [40, 40, 20]) < [bore / 2 - 1, bore / 2 - 1, 1]).all(axis=1)
    # Of the smallest some points stand alone among those of the rim.
    assert shut.counted[inside].mean() > 0.6
    decision = decide(shut, 0.2)
    assert decision.outcome == "fail"
    assert np.abs(decision.places[0].position[:2] - 40).max() < bore / 2


def test_a_pin_on_the_part_fails_and_a_clamp_that_reaches_over_its_edge_does_not() -> None:
    rng = np.random.default_rng(8)
    turn, height = rng.uniform(0, 2 * np.pi, 3_000), rng.uniform(20, 30, 3_000)
    pin = np.column_stack([20 + 3 * np.cos(turn), 20 + 3 * np.sin(turn), height])
    held = on_plate(12.0, pin, closed=False)
    assert held.counted[:3_000].mean() > 0.95
    assert decide(held, 0.2).outcome == "fail"
    # Its pad touches the part; its upper side and its front end are seen.
    arm = np.column_stack([rng.uniform([-30, 55], [12, 65], (5_000, 2)), np.full(5_000, 28.0)])
    front = np.column_stack([np.full(1_500, 12.0), rng.uniform([55, 20], [65, 28], (1_500, 2))])
    clamped = on_plate(12.0, np.vstack([arm, front]), closed=False)
    assert clamped.counted[:6_500].mean() < 0.02


def test_a_face_of_a_fixture_flush_with_the_part_is_left_out() -> None:
    rng = np.random.default_rng(9)
    jaw = np.column_stack([rng.uniform([80, 10], [105, 70], (10_000, 2)), np.full(10_000, 20.0)])
    found = on_plate(12.0, jaw, closed=False)
    far = found.points[:10_000, 0] > 80.0 + 1.2
    assert not found.counted[:10_000][far].any()


def sampled(rng: np.random.Generator, low: tuple[float, float, float], high: tuple[float, float, float]) -> np.ndarray:
    """Points of a rectangle between two corners that share one coordinate, as dense as those of the plate."""
    wide = np.subtract(high, low)
    return rng.uniform(low, high, (int(6.25 * np.prod(wide[wide > 0])), 3))


def test_a_jaw_that_hides_some_of_a_face_is_not_that_face_out_of_place() -> None:
    rng = np.random.default_rng(10)
    jaw = sampled(rng, (92, 20, 0), (92, 60, 16))
    side = [sampled(rng, (80, 0, 0), (80, 20, 20)), sampled(rng, (80, 60, 0), (80, 80, 20))]
    held = on_plate(12.0, np.vstack([jaw, *side]), closed=False)
    assert not held.counted[: len(jaw)].any()
    assert decide(held, 0.2).outcome == "pass"
    # With nothing of the face in its place it is the face.
    thick = on_plate(12.0, sampled(rng, (92, 0, 0), (92, 80, 20)), closed=False, table=False)
    assert decide(thick, 0.2).outcome == "fail"


def test_the_pad_beneath_a_clamp_is_not_a_pin_on_the_part() -> None:
    rng = np.random.default_rng(11)
    turn = rng.uniform(0, 2 * np.pi, 600)
    pad = np.column_stack([12 + 3 * np.cos(turn), 20 + 3 * np.sin(turn), rng.uniform(20, 23, 600)])
    arm = sampled(rng, (-30, 15, 32), (16, 25, 32))
    clamped = on_plate(12.0, np.vstack([pad, arm]), closed=False)
    assert clamped.counted[: 600 + len(arm)].mean() < 0.02
    # Without the arm it is a burr.
    assert decide(on_plate(12.0, pad, closed=False), 0.2).outcome == "fail"


def test_a_pin_beside_a_wall_of_the_part_fails() -> None:
    rng = np.random.default_rng(12)
    mesh = Mesh(*angle(length=30.0, height=30.0, width=40.0, bend_radius=0.5, large_hole=3.0, small_hole=2.0))
    floor, wall = sampled(rng, (2.5, 0, 2), (30, 40, 2)), sampled(rng, (2, 0, 2.5), (2, 40, 30))
    floor = floor[np.linalg.norm(floor[:, :2] - [6, 12], axis=1) > 3.0]
    turn, height = rng.uniform(0, 2 * np.pi, 1_500), rng.uniform(2, 12, 1_500)
    pin = np.column_stack([6 + 3 * np.cos(turn), 12 + 3 * np.sin(turn), height])
    points = np.vstack([pin, floor, wall])
    points += rng.normal(0.0, NOISE, points.shape)
    held = measure_deviations(points, mesh, MeshSurface(mesh), limit=REACH, noise=NOISE, spacing=0.4)
    assert held.counted[:1_500].mean() > 0.95


def test_what_closes_a_bore_below_its_rim_is_the_part_s_and_a_table_seen_through_it_is_not() -> None:
    rng = np.random.default_rng(13)
    for height, outcome in ((8.0, "fail"), (0.0, "pass")):
        bottom = sampled(rng, (30, 30, height), (50, 50, height))
        walls = [sampled(rng, (x, 30, height), (x, 50, 20)) for x in (30, 50)]
        walls += [sampled(rng, (30, y, height), (50, y, 20)) for y in (30, 50)]
        found = on_plate(20.0, np.vstack([bottom, *walls]), closed=False, table=False)
        assert decide(found, 0.2).outcome == outcome


def test_a_corner_that_was_not_cut_fails_and_a_jaw_flush_with_one_face_does_not() -> None:
    rng = np.random.default_rng(14)
    side = [sampled(rng, (80, 0, 0), (80, 68, 20)), sampled(rng, (0, 80, 0), (68, 80, 20))]
    filled = [sampled(rng, (80, 68, 0), (80, 80, 20)), sampled(rng, (68, 80, 0), (80, 80, 20))]
    corner = on_plate(56.0, np.vstack([*filled, *side]), closed=True, missing=(2, 2))
    assert decide(corner, 0.2).outcome == "fail"
    assert corner.counted[: sum(map(len, filled))].mean() > 0.5
    cut = [sampled(rng, (68, 68, 0), (68, 80, 20)), sampled(rng, (68, 68, 0), (80, 68, 20))]
    jaw = [sampled(rng, (80, 10, 20), (95, 60, 20)), sampled(rng, (80, 10, 0), (95, 10, 20))]
    held = on_plate(56.0, np.vstack([*jaw, *cut, *side]), closed=False, missing=(2, 2))
    assert decide(held, 0.2).outcome == "pass"


def test_the_wall_of_a_nest_seen_through_a_notch_goes_with_the_nest() -> None:
    rng = np.random.default_rng(15)
    nest = [sampled(rng, (80, -15, 12), (95, 95, 12)), sampled(rng, (80, 36, 0), (80, 44, 12))]
    side = [sampled(rng, (80, 0, 12), (80, 36, 20)), sampled(rng, (80, 44, 12), (80, 80, 20))]
    flanks = [sampled(rng, (44, y, 0), (80, y, 20)) for y in (36, 44)]
    held = on_plate(8.0, np.vstack([*nest, *side, *flanks]), closed=False, missing=(2, 1), table=False)
    assert decide(held, 0.2).outcome == "pass"
