"""Faults of a part in a recipe: `[[form_error]]` and `[[moved_feature]]`."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg._numbers import is_number, is_whole
from dqreg.errors import InputError
from dqreg.geometry.mesh import Mesh as PartMesh
from dqreg.geometry.mesh_faces import faces_of
from dqreg.geometry.mesh_surface import MeshSurface
from dqreg.rigid import pose, twist
from dqreg.synth.faults import form_error, moved_feature
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.recipe_keys import get_number, require_known
from dqreg.synth.scan import Scan

KEYS = {
    "form_error": ("face", "near", "amplitude", "waves", "direction", "axis"),
    "moved_feature": ("face", "near", "shift", "rotation_deg", "larger", "axis"),
}


@dataclasses.dataclass(frozen=True)
class Fault:
    """One fault of the part, as a recipe states it."""

    kind: str  # "form_error" or "moved_feature"
    entry: str  # Its name in the recipe, such as "form_error 2"
    face: int | None  # Number of `dqreg faces`
    near: tuple[float, ...] | None  # Or a place that the face is nearest to
    amplitude: float = 0.0
    waves: int = 2
    direction: tuple[float, ...] | None = None
    shift: tuple[float, ...] = (0.0, 0.0, 0.0)
    rotation_deg: tuple[float, ...] = (0.0, 0.0, 0.0)  # About the middle of the face, a rotation vector
    larger: float = 0.0
    axis: tuple[float, ...] | None = None  # Point and direction of a round face

    def triangles(self, part: Mesh) -> IntArray:
        """Those of the part's mesh that the fault is on."""
        mesh = PartMesh(*part)
        count, labels = faces_of(mesh)
        number = self.face
        if self.near is not None:
            number = int(labels[MeshSurface(mesh).closest(np.array([self.near])).elements[0]])
        if number is None or number >= count:
            raise InputError(f"recipe: {self.entry}.face is {number}; the part's faces are 0 to {count - 1}")
        return np.flatnonzero(labels == number)

    def made(self, scan: Scan, part: Mesh) -> Scan:
        """The scan of the part with this fault."""
        triangles = self.triangles(part)
        axis = None if self.axis is None else (np.array(self.axis[:3]), np.array(self.axis[3:]))
        try:
            if self.kind == "form_error":
                chosen = {"waves": self.waves, "direction": self.direction, "axis": axis}
                return form_error(scan, part, triangles, self.amplitude, **chosen)  # type: ignore[arg-type]
            return moved_feature(scan, part, triangles, self.motion(part, triangles), larger=self.larger, axis=axis)
        except InputError as error:
            raise InputError(f"recipe: {self.entry}: {error}") from error

    def motion(self, part: Mesh, triangles: IntArray) -> FloatArray:
        """Of a moved feature, in the part's frame: rotated about the middle of its face, then translated."""
        mesh = PartMesh(*part)
        sizes = mesh.face_areas[triangles]
        centre = sizes @ mesh.corners[triangles].mean(axis=1) / sizes.sum()
        turned = pose.about(twist.exp(np.r_[np.deg2rad(self.rotation_deg), 0.0, 0.0, 0.0]), centre)
        return pose.from_parts(np.eye(3), np.array(self.shift)) @ turned

    def record(self, part: Mesh) -> dict[str, Any]:
        """What `truth.json` says of it: the entry of the recipe, defaults filled in, with the number of the face."""
        mesh = PartMesh(*part)
        keys = [key for key in KEYS[self.kind] if key != "near"]
        values = {key: getattr(self, key) for key in keys}
        return {"kind": self.kind, **values, "face": int(faces_of(mesh)[1][self.triangles(part)[0]])}


def read_faults(data: Mapping[str, Any], scanner_kind: str) -> tuple[Fault, ...]:
    """The faults of a recipe, form errors first, each entry checked under its name."""
    found = []
    for kind, keys in KEYS.items():
        entries = data.get(kind, [])
        if not isinstance(entries, list) or not all(isinstance(each, dict) for each in entries):
            raise InputError(f"recipe: {kind} must be written as [[{kind}]]; got {entries!r:.80}")
        for number, entry in enumerate(entries, 1):
            require_known(entry, keys, f"{kind} {number}.")
            found.append(_fault(kind, entry, f"{kind} {number}"))
    if found and (scanner_kind == "tactile" or data.get("motion")):
        what = "a tactile probe" if scanner_kind == "tactile" else "a part that moves meanwhile"
        raise InputError(f"recipe: [[{found[0].kind}]] means nothing for {what}; take it out")
    return tuple(found)


def _fault(kind: str, entry: Mapping[str, Any], name: str) -> Fault:
    if ("face" in entry) == ("near" in entry):
        raise InputError(f"recipe: {name} needs face = NUMBER of `dqreg faces`, or near = [x, y, z], one of them")
    counts = {"near": 3, "direction": 3, "shift": 3, "rotation_deg": 3, "axis": 6}
    values: dict[str, Any] = {
        key: _numbers(entry[key], f"{name}.{key}", n) for key, n in counts.items() if key in entry
    }
    if kind == "form_error":
        if "amplitude" not in entry:
            raise InputError(f"recipe: {name}.amplitude is missing; give the form error as a length")
        values["amplitude"] = get_number(entry, f"{name}.amplitude", 0.0)
    for key in ("waves", "face"):
        if key in entry:
            values[key] = _whole(entry[key], f"{name}.{key}", 2 if key == "waves" else 0)
    if "larger" in entry:
        values["larger"] = _numbers([entry["larger"]], f"{name}.larger", 1)[0]
    return Fault(kind, name, values.pop("face", None), values.pop("near", None), **values)


def _numbers(given: Any, name: str, count: int) -> tuple[float, ...]:
    good = isinstance(given, list) and len(given) == count
    if not good or not all(is_number(x) and abs(x) < 1e15 for x in given):
        raise InputError(
            f"recipe: {name} must be {'a number' if count == 1 else f'{count} numbers'}; got {given!r:.80}"
        )
    return tuple(float(x) for x in given)


def _whole(given: Any, name: str, least: int) -> int:
    if not is_whole(given) or given < least:
        raise InputError(f"recipe: {name} must be a whole number from {least} on; got {given!r}")
    return int(given)
