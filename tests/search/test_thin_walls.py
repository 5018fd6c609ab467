from __future__ import annotations

import numpy as np
import pytest

from dqreg.compare.trust.sheets import folded
from dqreg.geometry import Mesh, MeshSurface
from dqreg.search.thin_walls import MAX_THICKNESS_DIAGONALS, ThinWalls, thickness_at
from dqreg.synth.parts import box


@pytest.mark.parametrize("seed", range(4))
def test_both_sides_of_every_leg_of_a_sheet_are_found_with_its_thickness(seed):
    sheet = folded(np.random.default_rng(seed))
    walls = ThinWalls.of(sheet.mesh, MeshSurface(sheet.mesh))
    np.testing.assert_allclose(walls.thickness, sheet.thickness, rtol=5e-3)
    for normal in np.concatenate([sheet.across, -sheet.across]):
        assert (walls.normals @ normal).max() > 1.0 - 1e-9


@pytest.mark.parametrize(("height", "count"), [(0.9, 2), (1.1, 0)])
def test_walls_are_thin_up_to_a_share_of_the_size(height, count):
    part = Mesh(*box((100.0, 80.0, height * MAX_THICKNESS_DIAGONALS * np.hypot(100.0, 80.0))))
    assert len(ThinWalls.of(part, MeshSurface(part)).thickness) == count


def test_the_gap_between_two_walls_is_no_wall():
    part = Mesh(*box((100.0, 80.0, 2.0)))
    places = part.corners.mean(axis=1)
    outwards = thickness_at(places, -part.face_normals, MeshSurface(part), 5.0)
    assert np.isinf(outwards).all()
