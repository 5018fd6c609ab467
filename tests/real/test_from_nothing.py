"""Real CAD parts from random poses, no start given: thin plates and a part among much that is not it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import dqreg
from dqreg.given import read_any
from dqreg.rigid import pose
from dqreg.synth import Noise, Scanner, random_pose, scan_mesh, worst_vertex_displacement

pytestmark = pytest.mark.real


# Truth: the drawn pose itself. One part of each kind: solid, plate with pockets, plate with holes that is nearly
# its own mirror image. 1e-3 is far below the distance to any other pose that nearly fits.
@pytest.mark.parametrize("name", ["featuretype.STL", "counterXP.3MF", "plate_holes.STL"])
def test_two_views_from_a_random_pose(real_data: Path, name: str) -> None:
    part = read_any(real_data / "trimesh_cad" / name, "part")
    assert isinstance(part, dqreg.Mesh)
    rng = np.random.default_rng(1)
    views = [tuple(v) for v in rng.normal(size=(2, 3))]
    noise = Noise(range_sigma=3e-4 * part.diagonal)
    scan = scan_mesh(part.vertices, part.faces, Scanner(views, pixels=200), noise, rng=rng)
    truth = random_pose(rng, part.diagonal, part.centre)
    result = dqreg.register(pose.apply(pose.inverse(truth), scan.points), part, effort="fast")
    assert worst_vertex_displacement(result.T_target_source, truth, part.vertices) < 1e-3 * part.diagonal
