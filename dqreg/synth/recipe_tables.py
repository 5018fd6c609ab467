"""The tables of a recipe that need more than a look at each key: part, scanner, noise and motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.errors import InputError
from dqreg.synth import parts
from dqreg.synth.cameras import Scanner
from dqreg.synth.motion import Motion
from dqreg.synth.noise import Noise
from dqreg.synth.patterns import Lidar, StructuredLight
from dqreg.synth.raycast import check_mesh
from dqreg.synth.recipe_keys import build, get_text, keywords_of, require_known
from dqreg.synth.tactile import TactileProbe

AnyScanner = Scanner | StructuredLight | Lidar | TactileProbe
SCANNERS: Mapping[str, Callable[..., AnyScanner]] = {
    "camera": Scanner,
    "structured_light": StructuredLight,
    "lidar": Lidar,
    "tactile": TactileProbe,
}


def check_part(part: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the table ``[part]`` with its kind or file checked; dimensions are checked as the part is made."""
    if "file" in part:
        require_known(part, ("file",), "part.")
        get_text(part, "part.file", "")
        return part
    if "kind" not in part:
        raise InputError(f"recipe: part.kind is missing; give one of {', '.join(parts.KINDS)}, or part.file")
    get_text(part, "part.kind", "", parts.KINDS)
    return part


def make_mesh(part: Mapping[str, Any], folder: Path) -> parts.Mesh:
    """Build or read the part, rounded to float32 as an STL file holds it."""
    if "file" in part:
        vertices, faces = _read_mesh(folder / part["file"])
        return _rounded(vertices), faces
    dimensions = {key: value for key, value in part.items() if key != "kind"}
    vertices, faces = build(parts.KINDS[part["kind"]].build, "part", dimensions)
    rounded = _rounded(vertices)
    if len(np.unique(rounded, axis=0)) < len(vertices):
        raise InputError(
            f"recipe: part: its dimensions {dimensions} are too different from each other: vertices of the "
            f"{part['kind']} fall together in float32, as STL files hold them; give sizes of the same order"
        )
    return rounded, faces


def symmetry_of_part(part: Mapping[str, Any]) -> parts.Symmetry | None:
    """Find the motions that put the part onto itself."""
    if "file" in part:
        return None
    dimensions = {key: value for key, value in part.items() if key != "kind"}
    return parts.symmetry_of(part["kind"], keywords_of(parts.KINDS[part["kind"]].build, "part", dimensions))


def make_scanner(table: Mapping[str, Any]) -> tuple[str, AnyScanner]:
    """Make the scanner of the table ``[scanner]``."""
    kind = get_text(table, "scanner.kind", "camera", SCANNERS)
    if "views" not in table and kind != "tactile":
        raise InputError("recipe: scanner.views is missing; give directions [x, y, z] from part to sensor")
    keys = {key: value for key, value in table.items() if key != "kind"}
    made: AnyScanner = build(SCANNERS[kind], "scanner", keys)
    return kind, made


def make_noise(table: Mapping[str, Any], scanner_kind: str) -> Noise:
    """Make the error model of the table ``[noise]``."""
    noise = build(Noise, "noise", table)
    foreign = sorted(set(table) - {"range_sigma"})
    if scanner_kind == "tactile" and foreign:
        raise InputError(
            f"recipe: noise.{foreign[0]} = {table[foreign[0]]!r} means nothing for a tactile probe; it takes "
            "noise.range_sigma alone, along the normal"
        )
    return noise


def make_motion(table: Mapping[str, Any], scanner_kind: str) -> Motion | None:
    """Make the motion of the table ``[motion]``."""
    if not table:
        return None
    if scanner_kind == "tactile":
        raise InputError("recipe: [motion] means nothing for a tactile probe; take it out, or give another scanner")
    return build(Motion, "motion", table)


def _rounded(vertices: FloatArray) -> FloatArray:
    with np.errstate(over="ignore", under="ignore"):
        rounded = vertices.astype(np.float32).astype(np.float64)
    # A diagonal is squared on the way, also by those who work in float32.
    size = float(np.abs(rounded).max())
    if not 1e-15 < size < 1e15:
        raise InputError(f"recipe: part: its largest coordinate is {size:.3g}; it must lie between 1e-15 and 1e15")
    return rounded


def _read_mesh(path: Path) -> parts.Mesh:
    from dqreg.files import read_mesh

    try:
        mesh = read_mesh(path)
        return check_mesh(mesh.vertices, mesh.faces)
    except InputError as error:
        raise InputError(f"recipe: part.file: {error}") from error
