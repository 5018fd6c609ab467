from __future__ import annotations

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.geometry import CloudSurface, Mesh
from dqreg.registration.downsampling import Sides
from dqreg.registration.source import CentredSource, centre_source
from dqreg.registration.target_index import TargetIndex, index_target
from dqreg.synth.parts import bracket

SHEET = np.column_stack([np.random.default_rng(0).uniform(-1.0, 1.0, size=(40_000, 2)), np.zeros(40_000)])


def source(points: np.ndarray) -> CentredSource:
    return centre_source(points, None, None, np.random.default_rng(0))


def target(points: np.ndarray) -> TargetIndex:
    return index_target(points)


def test_dense_clouds_become_equal_cells_with_a_plane_at_each() -> None:
    sides = Sides.evened(source(SHEET), target(SHEET), 1_000)
    assert 800 <= len(sides.scan) <= 1_250
    assert sides.scan.directed.all()
    assert sides.scan.total == 40_000
    # A sheet of two by two in a thousand squares.
    assert sides.cell == pytest.approx(2.0 / np.sqrt(1_000), rel=0.1)
    assert isinstance(sides.surface, CloudSurface)
    assert len(sides.surface.normals) == pytest.approx(1_000, rel=0.25)


def test_sparse_clouds_and_meshes_stay_whole() -> None:
    few = SHEET[:2_900]
    stands = target(few)
    sides = Sides.evened(source(few), stands, 1_000)
    assert sides.cell == 0.0
    assert len(sides.scan) == 2_900
    assert sides.surface is stands.surface
    with pytest.raises(InputError, match="mesh"):
        Sides.evened(source(few), index_target(Mesh(*bracket())), 1_000)


def test_a_small_source_asks_for_cells_of_its_own_size() -> None:
    # A thousandth of the target's area: cells of the target would leave it one point.
    piece = SHEET[(np.abs(SHEET[:, :2]) < 0.1).all(axis=1)]
    sides = Sides.evened(source(piece), target(SHEET), 1_000)
    assert len(sides.scan) >= len(piece) / 2
    dense = np.column_stack([np.random.default_rng(1).uniform(-0.1, 0.1, size=(30_000, 2)), np.zeros(30_000)])
    sides = Sides.evened(source(dense), target(SHEET), 1_000)
    assert 500 <= len(sides.scan) <= 1_500


def test_a_dense_source_is_thinned_though_its_target_is_sparse() -> None:
    stands = target(SHEET[:2_900])
    sides = Sides.evened(source(SHEET), stands, 1_000)
    assert 800 <= len(sides.scan) <= 1_250
    assert sides.surface is stands.surface


def test_the_cells_of_a_target_are_built_once() -> None:
    stands = target(SHEET)
    assert stands.evened(1_000) is stands.evened(1_000)
    assert Sides.evened(source(SHEET), stands, 1_000).surface is stands.evened(1_000).surface
