from __future__ import annotations

import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import trimesh

from dqreg.errors import InputError
from dqreg.files import read_mesh

Tree = dict[str, Any]


def changed(path: Path, change: Callable[[Tree], object]) -> Path:
    whole = trimesh.Scene(trimesh.creation.icosphere(3)).export(file_type="glb")
    length = struct.unpack_from("<I", whole, 12)[0]
    tree = json.loads(whole[20 : 20 + length])
    change(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text + whole[20 + length :]
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    return path


def primitive(tree: Tree) -> Tree:
    found: Tree = tree["meshes"][0]["primitives"][0]
    return found


def positions(tree: Tree) -> Tree:
    found: Tree = tree["accessors"][primitive(tree)["attributes"]["POSITION"]]
    return found


def sparse(tree: Tree) -> None:
    positions(tree)["sparse"] = {"count": 1}


def chain(tree: Tree) -> None:
    tree["nodes"] = [{"children": [k + 1]} for k in range(20_000)] + [{"mesh": 0}]
    tree["scenes"] = [{"nodes": [0]}]


def doubled(tree: Tree) -> None:
    tree["nodes"] = [{"children": [k + 1, k + 1]} for k in range(30)] + [{"mesh": 0}]


REQUIRED = ["KHR_draco_mesh_compression", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing", "VENDOR_new"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *[(lambda t, name=name: t.update(extensionsRequired=[name]), f"extension {name}") for name in REQUIRED],
        (lambda t: t["nodes"][-1].update(extensions={"EXT_mesh_gpu_instancing": {}}), "EXT_mesh_gpu_instancing"),
        (lambda t: primitive(t).update(extensions={"KHR_draco_mesh_compression": {}}), "KHR_draco"),
        (sparse, "sparse accessors"),
        (lambda t: positions(t).update(componentType=5123), "three float32"),
        (lambda t: positions(t).pop("bufferView"), "without data"),
        (lambda t: primitive(t).update(mode=6), "triangle fans"),
        (lambda t: t["meshes"][0].update(primitives=[primitive(t)] * 2000), "unfold to"),
        (lambda t: t.update(bufferViews=t["bufferViews"] + [t["bufferViews"][0]] * 20_000), "views of more bytes"),
        (chain, "nodes more than 100 deep"),
        (doubled, "a node in two places"),
    ],
)
def test_what_would_be_misread_or_cost_too_much_is_refused_before_it_is_unfolded(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, change: Callable[[Tree], object], message: str
) -> None:
    path = changed(tmp_path / "a.glb", change)
    parsed: list[object] = []
    monkeypatch.setattr(trimesh, "load", lambda *given, **_: parsed.append(given))
    with pytest.raises(InputError, match=message):
        read_mesh(path)
    assert parsed == []


def test_extensions_of_appearance_change_nothing(tmp_path: Path) -> None:
    path = changed(tmp_path / "a.glb", lambda t: t.update(extensionsRequired=["KHR_materials_unlit"]))
    assert len(read_mesh(path).faces) == 1280
