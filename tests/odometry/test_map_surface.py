from __future__ import annotations

import numpy as np
import pytest

from dqreg.odometry.map_surface import MapSurface
from dqreg.rigid import pose


def points(count: int) -> np.ndarray:
    """A rough floor, with some places that points share."""
    rng = np.random.default_rng(1)
    found = rng.random((count, 3)) * [20.0, 20.0, 0.3]
    found[: count // 4] = found[: count // 4].round(1)
    return found


@pytest.mark.parametrize("size", [1, 2, 3, 4_000])
def test_a_hint_changes_no_bit_of_an_answer(size: int) -> None:
    surface, again, queries = (
        MapSurface(points(size)),
        MapSurface(points(size)),
        points(700) + np.array([0.05, 0.0, 0.1]),
    )
    hint = None
    for step in (0.0, 1e-3, 1e-3, 0.02, 0.3, 5.0, 1e-4):
        queries = pose.apply(pose.exp(np.array([0.0, 0.0, 0.01 * step, step, 0.3 * step, 0.0])), queries)
        found, expected = surface.closest(queries, hint), again.closest(queries)
        for name in ("points", "normals", "distances", "elements"):
            assert np.array_equal(getattr(found, name), getattr(expected, name)), (name, step)
        # What is kept for the next time may be less than the distance to the second, and never more.
        assert (found.others <= expected.others).all()
        hint = queries, found


def test_few_are_asked_again_after_a_small_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    surface, queries, asked = MapSurface(points(4_000)), points(700) + np.array([0.01, 0.0, 0.01]), []
    found = surface.closest(queries)
    nearest = surface._tree.nearest
    monkeypatch.setattr(surface._tree, "nearest", lambda some, k: asked.append(len(some)) or nearest(some, k))
    surface.closest(queries + 1e-3, (queries, found))
    assert sum(asked) < 70


def test_what_is_found_is_nearest_among_the_points_so_far() -> None:
    cloud, queries = points(4_000), points(300) + np.array([0.02, 0.03, 0.0])
    surface = MapSurface(cloud[:10])
    for count in (1_000, 1_900, 4_000):
        more = cloud[len(surface.points) : count]
        surface.room(len(more))[len(surface.points) : count] = more
        surface.grow(count)
        assert np.array_equal(surface.points, cloud[:count])
        found = surface.closest(queries)
        apart = np.linalg.norm(queries[:, None] - surface.points, axis=2)
        assert np.array_equal(found.points, surface.points[found.elements])
        assert (apart[np.arange(300), found.elements] == apart.min(axis=1)).all()
        # The planes are those of a surface that had all points at once.
        assert np.array_equal(found.normals, MapSurface(cloud[:count]).closest(queries).normals)
