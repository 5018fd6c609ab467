"""What a scan's points belong to, against scenes whose answer is known because they were made so."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import Mesh, MeshSurface
from dqreg.inspection import Deviations, measure_deviations
from dqreg.inspection.membership import BEYOND, EXCLUDED, ON_PART, OTHER_SURFACE, OUTLIER, in_boxes
from dqreg.synth.parts import box

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
    with pytest.raises((InputError, ValueError), match=r"six coordinates|could not convert"):
        in_boxes(np.zeros((2, 3)), [box])  # type: ignore[list-item]
