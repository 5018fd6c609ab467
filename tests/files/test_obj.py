from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import read_mesh

TETRAHEDRON = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))


def volume(path: Path) -> float:
    mesh = read_mesh(path)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def body(number: int, *, negative: bool) -> str:
    rows = [f"v {x} {y} {z}" for x, y, z in (TETRAHEDRON + np.array([5.0 * number, 0, 0])).tolist()]
    shift = -5 if negative else 4 * number
    faces = ["f " + " ".join(f"{k + shift}/{k}/{k}" for k in face) for face in FACES]
    return "\n".join([f"o body{number}", *rows, *faces, ""])


def test_negative_indices_count_back_from_their_own_line(tmp_path: Path) -> None:
    (tmp_path / "back.obj").write_text("".join(body(k, negative=True) for k in range(3)))
    (tmp_path / "front.obj").write_text("".join(body(k, negative=False) for k in range(3)))
    back, front = read_mesh(tmp_path / "back.obj"), read_mesh(tmp_path / "front.obj")
    np.testing.assert_array_equal(back.vertices, front.vertices)
    np.testing.assert_array_equal(back.faces, front.faces)
    assert volume(tmp_path / "back.obj") == pytest.approx(0.5)


def test_weights_of_one_colours_comments_and_continued_lines_are_read(tmp_path: Path) -> None:
    rows = ["v 0 0 0 1", "v 1 0 0 1.0 # weight", "v 0 1 0 0.5 0.5 0.5", "v 0 0 1 1 0 0 1"]
    faces = ["f 1 3 \\", " 2", "f 1 2 4", "f 1 4 3", "f 2 3 4"]
    (tmp_path / "a.obj").write_text("\r\n".join([*rows, *faces]))
    assert volume(tmp_path / "a.obj") == pytest.approx(1 / 6)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("v 1 1 1 2", "weight of 1"),
        ("v 1 1", "x y z"),
        ("f 1 2 0", "counted from 1"),
        ("f -9 1 2", "back from the last"),
        ("f 1 2 9", "names vertex 8"),
        ("f 1.5 2 3", "counted from 1"),
        ("f 1 2 99999999999999999999", "counted from 1"),
        ("surf 0 1 0 1 1 2 3", "faces only"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, line: str, message: str) -> None:
    (tmp_path / "a.obj").write_text(body(0, negative=False) + line + "\n")
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / "a.obj")
