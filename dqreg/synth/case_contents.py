"""What the files of a case hold: recipe in, bytes out."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from dqreg._arrays import FloatArray, IntArray
from dqreg.files.strict_json import plain
from dqreg.files.write import ply_bytes
from dqreg.rigid import pose
from dqreg.synth.coverage import visible_share
from dqreg.synth.motion import Motion
from dqreg.synth.noise import Noise
from dqreg.synth.parts import Symmetry
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.range_bound import cramer_rao_bound
from dqreg.synth.raycast import centre_and_diagonal
from dqreg.synth.recipe import Recipe
from dqreg.synth.recipe_keys import named
from dqreg.synth.recipe_tables import AnyScanner
from dqreg.synth.scan import Scan
from dqreg.synth.scanner import scan_mesh
from dqreg.synth.scene import Scene
from dqreg.synth.tactile import TactileProbe, touch_mesh
from dqreg.synth.truth import disturbance, random_pose

SCAN, PART, TRUTH, RECIPE = "scan.ply", "part.stl", "truth.json", "recipe.toml"


def case_contents(recipe: Recipe) -> dict[str, bytes]:
    """Bytes of the files of a case: ``scan.ply``, ``part.stl``, ``truth.json`` and ``recipe.toml``."""
    vertices, faces = recipe.mesh()
    centre, S = centre_and_diagonal(vertices)
    scan_rng, pose_rng, scene_rng = recipe.streams()
    with named("scene", _keys(recipe.scene)):
        surroundings = recipe.scene.surroundings(vertices, scene_rng)
    scan = _scan(recipe, (vertices, faces), surroundings, scan_rng)
    T_source_target = random_pose(pose_rng, recipe.frame_offset * S, centre)
    T_target_source = pose.inverse(T_source_target)
    moved = scan.moved(T_source_target)
    step = disturbance(pose_rng, recipe.start_angle_rad, recipe.start_offset * S, centre)
    truth = {  # poses first: this is what a reader looks for
        "T_target_source": plain(T_target_source),
        "T_start": plain(step @ T_target_source),
        "units": recipe.units,
        "part_diagonal": S,
        "range_sigma": recipe.noise.range_sigma,
        "seed": recipe.seed,
        "name": recipe.name,
        "recipe": RECIPE,
        "start_angle_deg": float(np.rad2deg(recipe.start_angle_rad)),
        "start_offset": recipe.start_offset * S,
        "points": len(scan.points),
        "part_points": int(scan.on_part.sum()),
        "outliers": int(scan.is_outlier.sum()),
        "faces": len(faces),
        "surface_seen": _seen(recipe, (vertices, faces), surroundings),
        "cramer_rao_rms": _bound(recipe, scan, vertices),
        "sensor_positions": plain(moved.sensor_positions),
        **symmetry_record(recipe.symmetry(), T_target_source),
        "motion": motion_record(recipe.motion, centre, S, T_source_target),
        **settings_record(recipe),
        **({"faults": [fault.record((vertices, faces)) for fault in recipe.faults]} if recipe.faults else {}),
    }
    # The folder shall make itself again, also where the part came from a file that lies elsewhere.
    text = re.sub(r"(?m)^file\s*=.*$", f'file = "{PART}"', recipe.text)
    return {
        SCAN: _scan_bytes(recipe, moved),
        PART: stl_bytes(vertices, faces),
        TRUTH: json_text(truth).encode(),
        RECIPE: text.encode(),
    }


def _scan(recipe: Recipe, part: Mesh, surroundings: Mesh | None, rng: np.random.Generator) -> Scan:
    with named("noise", _keys(recipe.noise)):
        recipe.noise.require_fit(centre_and_diagonal(part[0])[1])
    with named("scanner", _keys(recipe.scanner)):
        if isinstance(recipe.scanner, TactileProbe):
            return touch_mesh(*part, recipe.scanner, recipe.noise.range_sigma, rng=rng)
        scan = scan_mesh(*part, recipe.scanner, recipe.noise, rng=rng, motion=recipe.motion, surroundings=surroundings)
    for fault in recipe.faults:
        scan = fault.made(scan, part)
    return scan


def _scan_bytes(recipe: Recipe, scan: Scan) -> bytes:
    """Binary PLY of a scan in the precision of the recipe, with the normals of a probe and the times of a motion."""
    columns = dict(zip("xyz", scan.points.astype(recipe.coordinates).T, strict=True))
    comments = [f"units {recipe.units}"]
    if isinstance(recipe.scanner, TactileProbe):
        columns |= zip(("nx", "ny", "nz"), scan.normals.astype(recipe.coordinates).T, strict=True)
    if recipe.motion:
        columns["time"] = scan.times
        comments += ["time in sweeps; the motion is in truth.json"]
    return ply_bytes({name: (values, f"f{values.itemsize}") for name, values in columns.items()}, comments)


def _keys(settings: Scene | Noise | AnyScanner) -> list[str]:
    return [field.name for field in dataclasses.fields(settings)]


def _seen(recipe: Recipe, part: Mesh, surroundings: Mesh | None) -> float | None:
    """Fraction of the surface that is seen; None for a probe, which sees nothing."""
    if isinstance(recipe.scanner, TactileProbe):
        return None
    limit = recipe.noise.max_incidence_rad
    share = visible_share(*part, recipe.scanner, max_incidence_rad=limit, surroundings=surroundings)
    return round(share, 3)


def _bound(recipe: Recipe, scan: Scan, vertices: FloatArray) -> float:
    """Cramer-Rao bound from the points on the part, the motion taken as known."""
    good = scan.on_part
    if recipe.motion is not None:
        centre, diagonal = centre_and_diagonal(vertices)
        scan = scan.undone(recipe.motion.twist(centre, diagonal), recipe.motion.reference)
    if not np.all(scan.total_sigma[good] > 0.0):
        return 0.0  # without noise the truth can be found exactly
    bound = cramer_rao_bound(
        scan.points[good], scan.ray_directions[good], scan.normals[good], scan.total_sigma[good], vertices
    )
    return float(f"{bound:.6g}")


def stl_bytes(vertices: FloatArray, faces: IntArray) -> bytes:
    """Binary STL of a mesh."""
    import trimesh

    content: bytes = trimesh.exchange.stl.export_stl(trimesh.Trimesh(vertices, faces, process=False))
    return content


def symmetry_record(symmetry: Symmetry | None, T_target_source: FloatArray) -> dict[str, Any]:
    """Which other poses are true."""
    if symmetry is None:
        return {"symmetric_truths": None, "near_symmetric_truths": None, "symmetry_axis": None}
    axis = symmetry.axis
    return {
        "symmetric_truths": plain(np.concatenate([T_target_source[None], symmetry.poses[1:] @ T_target_source])),
        "near_symmetric_truths": plain(symmetry.near @ T_target_source),
        "symmetry_axis": None if axis is None else {"point": plain(axis[0]), "direction": plain(axis[1])},
    }


def motion_record(motion: Motion | None, centre: FloatArray, diagonal: float, T: FloatArray) -> dict[str, Any] | None:
    """How the part moved, in the frame of the scan."""
    if motion is None:
        return None
    twist = pose.adjoint(T) @ motion.twist(centre, diagonal)
    return {
        "twist": plain(twist),
        "reference_time": float(motion.reference),
        "time_unit": "sweep",
        "undo": "p(reference_time) = exp((reference_time - time) twist) p; twist: rotation first, scan frame",
    }


def settings_record(recipe: Recipe) -> dict[str, Any]:
    """Scanner and error model, defaults filled in.

    Keys are those of the recipe; angles are in degrees, no scene is None.
    """
    return {
        "scanner": {"kind": recipe.scanner_kind, **_in_degrees(dataclasses.asdict(recipe.scanner))},
        "noise": _in_degrees(dataclasses.asdict(recipe.noise)),
        "scene": None if recipe.scene.kind == "none" else dataclasses.asdict(recipe.scene),
    }


def json_text(record: Mapping[str, Any]) -> str:
    """JSON for people too: one line a key, and one a row of a matrix."""
    text = json.dumps(record, indent=2, allow_nan=False)
    rows = re.compile(r"\[\s+([^][{}\"]*?)\s+\]")  # lists of numbers; the only text with brackets is quoted
    return rows.sub(lambda row: "[" + re.sub(r"\s+", " ", row[1]) + "]", text) + "\n"


def _in_degrees(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Angles as the recipe has them; twelve digits, so that 80 degrees do not become 80.00000000000001."""
    return {
        key.removesuffix("_rad") + "_deg" if key.endswith("_rad") else key: float(f"{np.rad2deg(value):.12g}")
        if key.endswith("_rad") and value is not None
        else value
        for key, value in settings.items()
    }
