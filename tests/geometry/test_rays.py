"""Whether a file in KITTI's layout is a sweep about its origin, or a part."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg import register
from dqreg._arrays import FloatArray
from dqreg.geometry import Mesh, PointCloud, sample_mesh
from dqreg.geometry.opening import as_geometry
from dqreg.geometry.rays import is_sweep
from dqreg.synth.parts import bracket
from dqreg.synth.street import street, swept


def saved(path: Path, points: FloatArray) -> Path:
    np.column_stack([points, np.ones(len(points))]).astype("<f4").tofile(path)
    return path


def drive(rings: int, half_deg: float, seed: int) -> FloatArray:
    T, rng = np.eye(4), np.random.default_rng(seed)
    T[2, 3] = 1.8
    azimuths = np.deg2rad(np.arange(-half_deg, half_deg, 0.4))
    found = swept(street(rng), T, np.deg2rad(np.linspace(-22.0, 10.0, rings)), azimuths)
    return found + rng.normal(0.0, 0.01, found.shape)


@pytest.mark.parametrize(("rings", "half_deg"), [(16, 180.0), (64, 180.0), (64, 45.0)])
def test_a_sweep_is_seen_from_its_origin_in_metres(tmp_path: Path, rings: int, half_deg: float) -> None:
    points = drive(rings, half_deg, 63_201)
    cloud = as_geometry(saved(tmp_path / "a.bin", points), "source")
    assert isinstance(cloud, PointCloud)
    assert (cloud.units, cloud.viewpoint is not None) == ("m", True)
    # In any order; but not in the frame of a map.
    assert is_sweep(np.random.default_rng(63_202).permutation(points))
    assert not is_sweep(points - np.array([60.0, 25.0, 0.0]))


@pytest.mark.parametrize("share", [0.0, 0.3, 0.5])
def test_a_part_has_no_viewpoint_and_no_unit_and_is_accepted(tmp_path: Path, share: float) -> None:
    part, rng = Mesh(*bracket()), np.random.default_rng(63_203)
    origin = part.centre + share * (part.bounds[1] - part.bounds[0])
    cloud = sample_mesh(part, 20_000, rng)
    points = cloud.points + rng.normal(0.0, 0.02, cloud.points.shape) - origin
    path = saved(tmp_path / "a.bin", points)
    found = as_geometry(path, "source")
    assert isinstance(found, PointCloud)
    assert (found.units, found.viewpoint) == (None, None)
    start = np.eye(4)
    start[:3, 3] = origin
    result = register(path, part, start, effort="fast")
    assert result.verdict.level == "accepted"
    assert "source_viewpoint" not in result.settings
