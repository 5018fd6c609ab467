"""What is left between two clouds: of corners that three planes hold, of sheets without one, and of parts."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, sample_mesh
from dqreg.registration.fit.fit import Fit
from dqreg.registration.overlap.cloud_overlap import evidence_between_clouds, have_planes_alone, planes_of
from dqreg.synth.parts import box
from tests.icp.scenes import bumpy_cloud
from tests.registration.scenes import fit_of, problem_of

PART = Mesh(*box((100.0, 60.0, 40.0)))
NOISE = 0.02
SURE = 1e-10 * np.eye(6)
SHAPE = ("faces_apart", "ends_apart", "opposed_edges", "rims_shared", "deformation", "waviness", "stretch", "bend")


def corner(seed: int, unit: float = 1.0) -> FloatArray:
    """Points of the three faces of a block that meet in a corner."""
    rng = np.random.default_rng(seed)
    sampled = sample_mesh(PART, 3_000, rng)
    assert sampled.normals is not None
    shown = sampled.points[(sampled.normals > 0.5).any(axis=1)]
    return unit * (shown + NOISE * rng.normal(size=shown.shape))


def fit(source: FloatArray, target: FloatArray | Mesh) -> Fit:
    return fit_of(problem_of(source, target, np.eye(4), effort="fast"))


def test_a_corner_is_planes_alone_and_the_faces_have_their_shares() -> None:
    found = fit(corner(1), corner(2))
    assert have_planes_alone(found)
    planes = planes_of(found)
    assert planes is not None
    assert planes.are_a_corner
    areas = np.array([100.0 * 60.0, 100.0 * 40.0, 60.0 * 40.0])
    np.testing.assert_allclose(planes.shares, areas / areas.sum(), atol=0.03)
    # The same again: it is asked for more than once.
    assert planes_of(found) is planes


def test_a_sheet_without_a_plane_and_a_part_have_none() -> None:
    sheets, part = fit(bumpy_cloud(2_000, 1), bumpy_cloud(2_000, 2)), fit(corner(1), PART)
    assert not have_planes_alone(sheets)
    assert not have_planes_alone(part)
    # On a part nothing is between two clouds.
    assert evidence_between_clouds(part, SURE) is part.agreement


def test_between_clouds_that_agree_nothing_is_left() -> None:
    found = fit(corner(1), corner(2))
    evidence = evidence_between_clouds(found, SURE)
    for name in ("faces_apart", "ends_apart", "opposed_edges", "closed_hole", "stretch", "bend"):
        assert getattr(evidence, name) == 0.0, name
    assert evidence.rims_shared > 0.8
    assert evidence.largest_plane == pytest.approx(6_000.0 / 12_400.0, abs=0.03)
    # All else is as the run tells it.
    others = {field.name for field in dataclasses.fields(evidence)} - {*SHAPE, "closed_hole", "rims_elsewhere"}
    for name in others - {"largest_plane", "stretched_along", "_common"}:
        np.testing.assert_equal(getattr(evidence, name), getattr(found.agreement, name))


def test_a_face_that_lies_apart_is_seen_and_one_that_the_other_shows_half_of() -> None:
    moved = corner(2)
    moved[moved[:, 2] > PART.bounds[1][2] - 1.0] += [0.0, 0.0, 1.0]
    apart = evidence_between_clouds(fit(corner(1), moved).at(np.eye(4)), SURE)
    assert apart.faces_apart > 0.0
    # A face of which one shows half ends there for that one alone: fewer rims are of both, and none is contradicted.
    cut = corner(2)
    cut = cut[~((cut[:, 2] > PART.bounds[1][2] - 1.0) & (cut[:, 0] < PART.centre[0]))]
    whole, half = (evidence_between_clouds(fit(corner(1), other), SURE) for other in (corner(2), cut))
    assert half.rims_shared < whole.rims_shared
    assert half._common < whole._common
    assert half.ends_apart == 0.0


@pytest.mark.parametrize("unit", [1e-3, 1e3])
def test_the_unit_is_no_matter(unit: float) -> None:
    # Rotations in radians, shifts in the unit.
    scale = np.repeat([1.0, unit], 3)
    expected = evidence_between_clouds(fit(corner(1), corner(2)), SURE)
    found = evidence_between_clouds(fit(corner(1, unit), corner(2, unit)), SURE * scale[:, None] * scale)
    for name in (*SHAPE, "closed_hole", "largest_plane", "_common"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=0.02), name
