"""A STEP part is cut as finely as its scan can tell, whatever the units, and the result says how finely."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg.files.mesh_data import MeshData
from dqreg.geometry import Mesh, sample_mesh
from dqreg.registration.problem import target_index
from dqreg.registration.problem.target_index import cut_for
from dqreg.registration.register import register
from dqreg.synth.parts import box
from tests.files.step_text import block_with_hole

pytest.importorskip("cascadio")


def scan_of(noise: float) -> np.ndarray:
    """Points of the block without its hole, with noise along the normals."""
    rng, mesh = np.random.default_rng(0), Mesh(*box((30.0, 20.0, 10.0)))
    cloud = sample_mesh(mesh, 4_000, rng)
    assert cloud.normals is not None
    return cloud.points + [15.0, 10.0, 5.0] + rng.normal(0.0, noise, (len(cloud.points), 1)) * cloud.normals


def test_the_chord_follows_the_noise_and_the_units(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (path := tmp_path / "part.step").write_bytes(block_with_hole())
    fine, coarse = (cut_for(path, scan_of(noise), "mm") for noise in (0.005, 0.05))
    # A tenth of the noise, as planes through neighbours show it: of the order of what was drawn.
    assert 0.5e-3 / 2 < fine[1] < 0.5e-3 * 2
    assert 5e-3 / 2 < coarse[1] < 5e-3 * 2
    assert len(fine[0].faces) > len(coarse[0].faces)
    # Numbers of the faces do not depend on it.
    assert fine[0].regions is not None
    assert coarse[0].regions is not None
    assert set(fine[0].regions) == set(coarse[0].regions)
    # The file is not read again: OpenCASCADE takes seconds.
    again = MeshData(coarse[0].vertices, coarse[0].faces, "mm", coarse[0].regions, coarse[1])
    monkeypatch.setattr(target_index, "read_step", lambda *_: again)
    # The same scan in inches of a part in mm.
    assert cut_for(path, scan_of(0.05) / 25.4, "inch")[1] == pytest.approx(coarse[1], rel=1e-6)
    found = register(scan_of(0.05), path, "identity", source_units="mm")
    assert found.settings["target"] == str(path)
    assert found.settings["chord"] == pytest.approx(coarse[1], rel=1e-6)
