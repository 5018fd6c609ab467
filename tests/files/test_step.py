"""STEP files: exact size, unit and faces; damaged ones end no process but their own."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError, MissingDependencyError
from dqreg.files import read_mesh, step
from dqreg.geometry import Mesh
from dqreg.inspection import part_faces
from tests.files.step_text import block_with_hole, ring

pytest.importorskip("cascadio")


def written(folder: Path, content: bytes) -> Path:
    path = folder / "part.step"
    path.write_bytes(content)
    return path


def test_a_block_has_its_size_unit_and_faces(tmp_path: Path) -> None:
    mesh = read_mesh(written(tmp_path, block_with_hole()))
    part = Mesh(mesh.vertices, mesh.faces, mesh.units, regions=mesh.regions)
    assert part.units == "mm"
    assert part.is_closed
    assert part.is_consistently_wound
    # Triangles within a chord of 1e-5 of the size; coordinates in single precision.
    wall = 2.0 * np.pi * 3.0 * 10.0
    assert part.volume == pytest.approx(6000.0 - 90.0 * np.pi, abs=wall * 1e-5 * part.diagonal + 6000.0 * 1e-6)
    faces = part_faces(part)
    # The two half cylinders of the wall are one hole.
    assert [face.kind for face in faces] == ["plane"] * 6 + ["cylinder"]
    hole = faces[6]
    assert hole.is_hole
    assert hole.feature is not None
    assert hole.feature.diameter == pytest.approx(6.0, rel=1e-7)
    assert hole.feature.point[:2] == pytest.approx([12.0, 8.0], abs=1e-5)


def test_a_ring_is_a_torus_cut_as_finely_as_its_triangles_allow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # At the default chord OpenCASCADE needs minutes for its 260,000 triangles.
    monkeypatch.setattr(step, "MOST_ON_ONE", 8_000)
    monkeypatch.setattr(step, "FIRST_CHORD_DIAGONALS", 2e-3)
    mesh = step.read_step(written(tmp_path, ring(12.0, 2.0)))
    assert 4_000 < len(mesh.faces) <= 8_000
    assert mesh.chord is not None
    assert mesh.chord > 1e-4 * 40.0
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    inside = 2.0 - np.hypot(np.hypot(centres[:, 0], centres[:, 1]) - 12.0, centres[:, 2])
    assert np.abs(inside).max() <= mesh.chord
    (face,) = part_faces(Mesh(mesh.vertices, mesh.faces, mesh.units, regions=mesh.regions))
    assert face.kind == "torus"
    assert face.torus is not None
    # Coordinates in single precision.
    assert (face.torus.major_radius, face.torus.minor_radius) == pytest.approx((12.0, 2.0), abs=14.0 * 1e-6)
    assert abs(face.torus.axis[2]) == pytest.approx(1.0, abs=1e-9)


def test_the_chord_is_kept_and_the_unit_is_that_of_the_shapes(tmp_path: Path) -> None:
    content = block_with_hole((3.0, 2.0, 1.0), (1.2, 0.8, 0.3), "inch")
    mesh = step.read_step(written(tmp_path, content), chord=1e-3)
    assert (mesh.units, mesh.chord) == ("inch", 1e-3)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx([3.0, 2.0, 1.0], abs=1e-6)
    assert mesh.regions is not None
    wall = mesh.vertices[mesh.faces[mesh.regions == 6]].mean(axis=1)
    off = 0.3 - np.linalg.norm(wall[:, :2] - [1.2, 0.8], axis=1)
    # Middles of triangles lie at two ninths to two thirds of the chord's height inside; none farther than the chord.
    assert 0.05e-3 < off.max() < 1e-3


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"something else", "no line ISO-10303-21"),
        (b"ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n", "no shape in it"),
        (block_with_hole()[:-400], "part.step: found"),
    ],
)
def test_what_is_no_part_is_refused_by_name(
    tmp_path: Path, content: bytes, words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match=words):
        read_mesh(written(tmp_path, content))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("child", "words"),
    [
        ("import os, signal; os.kill(os.getpid(), signal.SIGSEGV)", "by signal 11"),
        (step.TESSELLATE.replace("import cascadio", "while True: pass"), "OpenCASCADE does not cut within"),
        ("import time; time.sleep(60)", "OpenCASCADE does not cut within"),
        (step.TESSELLATE.replace("import cascadio", "bytearray(1 << 33)"), "no shape in it"),
    ],
)
def test_a_file_that_crashes_hangs_or_takes_all_memory_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, child: str, words: str
) -> None:
    monkeypatch.setattr(step, "TESSELLATE", child)
    monkeypatch.setattr(step, "BASE_SECONDS", 0.02 if "sleep" in child else 1.0)
    monkeypatch.setattr(step, "MEMORY_PER_BYTE", 0)
    with pytest.raises(InputError, match=words):
        read_mesh(written(tmp_path, block_with_hole()))


def test_without_the_package_the_command_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(MissingDependencyError, match=r"pip install 'dqreg\[step\]'"):
        read_mesh(written(tmp_path, block_with_hole()))


def test_units_and_sizes_by_the_text_alone() -> None:
    for prefix, unit in ((".MILLI.", "mm"), (".CENTI.", "cm"), (".MICRO.", "um"), ("$", "m")):
        assert step._unit(block_with_hole().replace(b".MILLI.", prefix.encode())) == unit
    assert step._unit(b"LENGTH_UNIT" * 10_000) == "mm"
    assert step._size(block_with_hole()) == pytest.approx(np.linalg.norm([30.0, 20.0, 10.0]))
    assert step._size(b"CARTESIAN_POINT('',(1e400,0,0))") == 100.0


@pytest.mark.soak
def test_damaged_files_end_no_process_but_their_own(tmp_path: Path) -> None:
    rng, content = np.random.default_rng(0), block_with_hole()
    refused = 0
    for _ in range(100):
        damaged = bytearray(content)
        for place in rng.integers(0, len(content), 8):
            damaged[place] = rng.integers(0, 256)
        try:
            assert np.isfinite(read_mesh(written(tmp_path, bytes(damaged))).vertices).all()
        except InputError:
            refused += 1
    assert 0 < refused < 100
