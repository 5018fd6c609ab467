from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import polygons, read_mesh
from dqreg.files.polygons import triangles

# An L, its notch seen by no fan from corner 0 or 1.
ELL = np.array([(2.0, 1), (2, 0), (0, 0), (0, 2), (1, 2), (1, 1)])


def star(spikes: int) -> np.ndarray:
    angle = np.arange(2 * spikes) * np.pi / spikes
    radius = np.where(np.arange(2 * spikes) % 2, 1.0, 0.2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def shoelace(flat: np.ndarray) -> float:
    x, y = flat.T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def areas(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def lifted(flat: np.ndarray) -> np.ndarray:
    return np.column_stack([flat, np.zeros(len(flat))])


COMB = np.array([(0.0, 0), (7, 0), (7, 5), (6, 5), (6, 1), (5, 1), (5, 5), (4, 5), (4, 1), (1, 1), (1, 5), (0, 5)])
BRIDGED = np.array([(0.0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)])


@pytest.mark.parametrize("flat", [ELL, star(5), star(40), COMB, BRIDGED, ELL[:, ::-1], np.roll(ELL, 2, axis=0)])
def test_triangles_of_a_concave_polygon_have_its_area_and_one_side(flat: np.ndarray) -> None:
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    for pose in (np.eye(3), turn):
        vertices = lifted(flat) @ pose.T + [1e3, -2e3, 5e2]
        found = areas(vertices, triangles(Path("a"), vertices, np.array([len(flat)]), np.arange(len(flat))))
        side = pose[:, 2] * np.sign(shoelace(flat))
        assert (found @ side > -1e-9).all()
        assert np.linalg.norm(found, axis=1).sum() == pytest.approx(abs(shoelace(flat)), rel=1e-9)


def test_many_concave_quadrilaterals_are_cut_at_the_other_diagonal_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    arrow = lifted(np.array([(1.0, 0), (3, 3), (0, 1), (0, 0)])[[2, 1, 0, 3]])
    arrow[3] = [0.9, 0.9, 0.0]
    vertices = np.concatenate([arrow + np.array([4.0 * k, 0, 0]) for k in range(20_000)])
    # All together: none has its ears searched for, and areas are looked at once for each of the two fans.
    looked: list[int] = []
    overlapping = polygons._overlapping
    monkeypatch.setattr(polygons, "_clipped", lambda *_: pytest.fail("an ear was searched for"))
    monkeypatch.setattr(polygons, "_overlapping", lambda *given: looked.append(0) or overlapping(*given))
    found = triangles(Path("a"), vertices, np.full(20_000, 4), np.arange(80_000))
    assert len(looked) == 2
    total = np.linalg.norm(areas(vertices, found), axis=1).sum()
    assert total == pytest.approx(20_000 * abs(shoelace(arrow[:, :2])), rel=1e-9)


def test_a_polygon_that_crosses_itself_is_refused() -> None:
    bow = lifted(np.array([(0.0, 0), (2, 1), (2, 0), (0, 1.5), (-1, 0.5)]))
    with pytest.raises(InputError, match="crosses itself"):
        triangles(Path("a"), bow, np.array([5]), np.arange(5))


def prism(flat: np.ndarray) -> tuple[np.ndarray, list[list[int]]]:
    flat = flat if shoelace(flat) > 0.0 else flat[::-1]
    n = len(flat)
    low, high = lifted(flat), lifted(flat) + np.array([0, 0, 1.0])
    sides = [[k, (k + 1) % n, n + (k + 1) % n, n + k] for k in range(n)]
    return np.concatenate([low, high]), [list(range(n))[::-1], list(range(n, 2 * n)), *sides]


@pytest.mark.parametrize("kind", ["obj", "off", "ply"])
@pytest.mark.parametrize("flat", [ELL, COMB, star(7)])
def test_a_part_with_concave_faces_has_its_volume_in_every_format(tmp_path: Path, kind: str, flat: np.ndarray) -> None:
    vertices, faces = prism(flat)
    rows = [" ".join(map(repr, row)) for row in vertices.tolist()]
    counted = [" ".join(map(str, [len(face), *face])) for face in faces]
    if kind == "obj":
        lines = [f"v {row}" for row in rows] + ["f " + " ".join(f"{k + 1}//1" for k in face) for face in faces]
    elif kind == "off":
        lines = ["OFF", f"{len(rows)} {len(faces)} 0", *rows, *counted]
    else:
        columns = [f"property double {name}" for name in "xyz"]
        lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}", *columns, f"element face {len(faces)}"]
        lines += ["property list uchar int vertex_indices", "end_header", *rows, *counted]
    path = tmp_path / f"part.{kind}"
    path.write_text("\n".join(lines) + "\n")
    mesh = read_mesh(path)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0
    border = np.linalg.norm(flat - np.roll(flat, 1, axis=0), axis=1).sum()
    assert volume == pytest.approx(abs(shoelace(flat)), rel=1e-12)
    area = np.linalg.norm(areas(mesh.vertices, mesh.faces), axis=1).sum()
    assert area == pytest.approx(2.0 * abs(shoelace(flat)) + border, rel=1e-12)
