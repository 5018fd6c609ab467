"""Limits of glTF files, checked before the parser runs.

glTF may name other files, promise numbers that no byte stands for, say the same bytes many times over, and require
extensions without which its bodies are others.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from dqreg.files.untrusted import ALLOWED_BYTES, ALLOWED_COUNT, MAX_DEPTH, max_faces, unreadable

# Extensions that change how a body looks, not where its surface is.
APPEARANCE = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "MSFT_texture_", "KHR_lights_", "KHR_xmp")
# Extensions that carry or place bodies, refused even where the file calls them optional.
BODIES = ("KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing", "EXT_meshopt_compression")
FLOAT32, TRIANGLE_FAN = 5126, 6


def require_safe_gltf(path: Path) -> None:
    """Raise if a glTF file names files outside its folder, promises too much, or has bodies that would be misread."""
    try:
        tree = json.loads(_gltf_json(path))
        uris = [item["uri"] for item in tree.get("buffers", []) if "uri" in item]
        counts = [item["count"] for item in tree.get("accessors", [])]
        views = [item["byteLength"] for item in tree.get("bufferViews", [])]
        primitives = [item for mesh in tree.get("meshes", []) for item in mesh["primitives"]]
        size = path.stat().st_size + sum(place.stat().st_size for place in _named_files(path, uris))
        if not all(type(count) is int and count >= 0 for count in counts) or sum(counts) > max(ALLOWED_COUNT, 4 * size):
            raise unreadable(path, f"accessors that promise more than {size} bytes hold", "accessors of what is there")
        if not all(type(length) is int and length >= 0 for length in views) or sum(views) > ALLOWED_BYTES + 4 * size:
            raise unreadable(path, f"buffer views of more bytes than the {size} there are", "views that do not overlap")
        _require_known_extensions(path, tree, primitives)
        _require_plain_bodies(path, tree["accessors"] if primitives else [], primitives)
        _require_shallow(path, tree.get("nodes", []))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, OSError) as error:
        if type(error).__module__.startswith("dqreg"):
            raise
        raise unreadable(path, f"glTF whose JSON cannot be used ({error!r:.80})", "a whole glTF file") from error


def buffers_of(path: Path) -> list[Path]:
    """Files that hold the numbers of a glTF file beside its own; none of a file that would be refused."""
    try:
        buffers = json.loads(_gltf_json(path)).get("buffers", [])
        return list(_named_files(path, [item["uri"] for item in buffers if "uri" in item]))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, OSError):
        return []


def _require_known_extensions(path: Path, tree: dict[str, Any], primitives: list[dict[str, Any]]) -> None:
    unknown = [str(name) for name in tree.get("extensionsRequired", []) if not str(name).startswith(APPEARANCE)]
    holders = (*primitives, *tree.get("nodes", []), *tree.get("bufferViews", []))
    used = {name for holder in holders for name in holder.get("extensions", ())}
    unknown += [name for name in BODIES if name in used]
    if unknown:
        found = f"the glTF extension {', '.join(dict.fromkeys(unknown))}"
        raise unreadable(path, found, "plain triangles; save it again without compression, quantization and instancing")


def _require_plain_bodies(path: Path, accessors: list[Any], primitives: list[dict[str, Any]]) -> None:
    placed = 0
    for primitive in primitives:
        positions = accessors[primitive["attributes"]["POSITION"]]
        indices = accessors[primitive["indices"]] if "indices" in primitive else positions
        if "sparse" in positions or "sparse" in indices:
            raise unreadable(path, "sparse accessors", "accessors with all their numbers")
        if positions["componentType"] != FLOAT32 or positions["type"] != "VEC3":
            raise unreadable(
                path, "positions that are not three float32", "three float32; save it without quantization"
            )
        if "bufferView" not in positions or "bufferView" not in indices:
            raise unreadable(path, "an accessor without data", "accessors with all their numbers")
        if primitive.get("mode") == TRIANGLE_FAN:
            raise unreadable(path, "triangle fans", "triangles or strips of them")
        placed += positions["count"] + indices["count"] // 3
    # Each position takes twelve bytes; bodies that share them are copied.
    if placed > max_faces(path):
        raise unreadable(path, f"bodies that share positions and unfold to {placed}", f"at most {max_faces(path)}")


def _require_shallow(path: Path, nodes: list[dict[str, Any]]) -> None:
    children = [child for node in nodes for child in node.get("children", ())]
    if len(set(children)) < len(children):
        raise unreadable(path, "a node in two places of the tree", "a tree of nodes")
    inner = set(children)
    level = [node for k, node in enumerate(nodes) if k not in inner]
    for _ in range(MAX_DEPTH):
        level = [nodes[child] for node in level for child in node.get("children", ())]
        if not level:
            return
    raise unreadable(path, f"nodes more than {MAX_DEPTH} deep", "a tree of nodes")


def _named_files(path: Path, uris: list[Any]) -> Iterator[Path]:
    folder = path.parent.resolve()
    for uri in uris:
        if not isinstance(uri, str):
            raise unreadable(path, f"a buffer at {uri!r:.80}", "the name of a file")
        # trimesh takes any text with this word for the data themselves.
        if "base64," in uri:
            continue
        try:
            places = [(folder / name).resolve() for name in (uri, unquote(uri))]
            inside = all(place.is_relative_to(folder) for place in places) and "\\" not in uri and "://" not in uri
            found = inside and places[0].is_file()
        except (OSError, ValueError, RuntimeError):
            inside = found = False
        if not inside:
            raise unreadable(path, f"a buffer at {uri!r:.80}", "files in its own folder")
        if not found:
            raise unreadable(path, f"a buffer at {uri!r:.80}, where no file is", "all files of the scene together")
        yield places[0]


def _gltf_json(path: Path) -> bytes:
    with path.open("rb") as stream:
        head = stream.read(20)
        if not head.startswith(b"glTF"):
            return head + stream.read()
        if len(head) < 20 or head[16:20] != b"JSON":
            raise ValueError("no JSON at the beginning")
        return stream.read(int.from_bytes(head[12:16], "little"))
