from __future__ import annotations

import zipfile
from pathlib import Path

import numpy as np
import pytest

from dqreg.errors import InputError
from dqreg.files import read_mesh, threemf

CORE = "http://schemas.microsoft.com/3dmanufacturing/core/2015/02"
PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
VERTICES = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)))
FACES = "".join(f'<triangle v1="{a}" v2="{b}" v3="{c}"/>' for a, b, c in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)))
TETRAHEDRON = f"<mesh><vertices>{VERTICES}</vertices><triangles>{FACES}</triangles></mesh>"
BODY = f'<object id="1">{TETRAHEDRON}</object>'


def model(objects: str, items: str = "", head: str = "") -> str:
    body = f"<resources>{objects}</resources><build>{items}</build>"
    return f'<?xml version="1.0"?><model xmlns="{CORE}" xmlns:p="{PRODUCTION}" {head}>{body}</model>'


def packed(path: Path, *files: str | bytes, level: int = 9) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=level) as archive:
        for name, content in zip(("3D/3dmodel.model", "3D/Objects/a.model"), files, strict=False):
            archive.writestr(name, content)
    return path


def item(number: int, shift: float = 0.0, more: str = "") -> str:
    return f'<item objectid="{number}" transform="1 0 0 0 1 0 0 0 1 {shift} 0 0" {more}/>'


def volume(path: Path) -> float:
    mesh = read_mesh(path)
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return 6.0 * float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def test_items_of_one_part_number_are_all_there(tmp_path: Path) -> None:
    items = "".join(item(1, 5.0 * k, 'partnumber="A"') for k in range(3))
    assert volume(packed(tmp_path / "a.3mf", model(BODY, items))) == pytest.approx(3.0)


@pytest.mark.parametrize("kind", ["support", "solidsupport"])
def test_supports_are_no_part(tmp_path: Path, kind: str) -> None:
    objects = BODY + f'<object id="2" type="{kind}">{TETRAHEDRON}</object>'
    assert volume(packed(tmp_path / "a.3mf", model(objects, item(1) + item(2, 9.0)))) == pytest.approx(1.0)
    with pytest.raises(InputError, match="no faces"):
        read_mesh(packed(tmp_path / "b.3mf", model(objects, item(2))))


def test_objects_of_other_files_are_other_objects_of_the_same_id(tmp_path: Path) -> None:
    path = 'p:path="/3D/Objects/a.model"'
    parts = f'<component objectid="1" {path} transform="2 0 0 0 2 0 0 0 2 9 0 0"/><component objectid="1"/>'
    objects = BODY + f'<object id="2"><components>{parts}</components></object>'
    other = model(BODY)
    assert volume(packed(tmp_path / "a.3mf", model(objects, item(2)), other)) == pytest.approx(9.0)
    mirrored = item(1).replace("1 0 0 0 1 0", "-1 0 0 0 1 0")
    assert volume(packed(tmp_path / "b.3mf", model(BODY, mirrored))) == pytest.approx(1.0)


@pytest.mark.parametrize(("unit", "expected"), [("", "mm"), ('unit="inch"', "inch"), ('unit="micron"', "um")])
def test_the_unit_is_millimetres_unless_stated(tmp_path: Path, unit: str, expected: str) -> None:
    assert read_mesh(packed(tmp_path / "a.3mf", model(BODY, item(1), unit))).units == expected


INSIDE_ITSELF = '<object id="1"><components><component objectid="1"/></components></object>'
DOCTYPE = '<?xml version="1.0" encoding="UTF-16"?><!DOCTYPE m [<!ENTITY a "1">]>' + model(BODY, item(1))[21:]


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (DOCTYPE.encode("utf-16"), "a document type"),
        (DOCTYPE.replace(' encoding="UTF-16"', ""), "a document type"),
        (model(BODY, item(7)), "'7', which is not there"),
        (model(BODY + BODY, item(1)), "two objects '1'"),
        (model(BODY, item(1), 'xmlns:b="x:/lattice/" requiredextensions="b"'), "the 3MF extension x:/lat"),
        (model(BODY, item(1).replace("1 0 0 0", "nan 0 0 0")), "twelve finite"),
        (model(BODY.replace('v1="0"', 'v1="9"'), item(1)), "names vertex -1"),
        (model(BODY.replace('v1="0"', ""), item(1)), "cannot be read"),
        (model(INSIDE_ITSELF, item(1)), "contain themselves"),
    ],
)  # fmt: skip
def test_a_bad_model_is_named(tmp_path: Path, content: str | bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_mesh(packed(tmp_path / "a.3mf", content))


def counted(monkeypatch: pytest.MonkeyPatch, owner: object, name: str, most: int) -> list[int]:
    """Calls of a function, which fails beyond a number of them: what has no end ends."""
    calls: list[int] = []
    real = getattr(owner, name)

    def call(*given: object) -> object:
        calls.append(len(calls))
        assert len(calls) <= most, name
        return real(*given)

    monkeypatch.setattr(owner, name, call)
    return calls


def test_a_file_that_many_components_name_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parts = '<component objectid="9" p:path="/3D/Objects/a.model"/>' * 3000
    objects = f'<object id="2"><components>{parts}</components></object>'
    other = model(f'<object id="1">{TETRAHEDRON * 2000}</object><object id="9">{TETRAHEDRON}</object>')
    parses = counted(monkeypatch, threemf._Models, "parse", 10)
    # The components lie in one place: their triangles are one after another.
    assert len(read_mesh(packed(tmp_path / "a.3mf", model(objects, item(2)), other)).faces) == 12_000
    assert len(parses) == 2


def test_a_model_that_packs_too_well_or_unfolds_too_far_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    many = model(BODY + "<x/>" * 17_000_000, item(1))
    with pytest.raises(InputError, match="that unpack to"):
        read_mesh(packed(tmp_path / "a.3mf", many, level=1))
    levels = [
        f'<object id="{k + 1}"><components>{f"<component objectid={chr(34)}{k}{chr(34)}/>" * 2}</components></object>'
        for k in range(1, 40)
    ]
    places = counted(monkeypatch, threemf, "_placement", threemf.MOST_PLACES)
    with pytest.raises(InputError, match="more than a million"):
        read_mesh(packed(tmp_path / "b.3mf", model(BODY + "".join(levels), item(40))))
    assert places
