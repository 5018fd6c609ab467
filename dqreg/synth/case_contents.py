"""What the files of a case hold: recipe in, bytes out."""

from __future__ import annotations

import dataclasses
import re

import numpy as np

from dqreg._arrays import FloatArray
from dqreg.files.strict_json import plain
from dqreg.rigid import pose
from dqreg.synth.bound import cramer_rao_bound
from dqreg.synth.case_files import (
    json_text,
    motion_record,
    ply_bytes,
    settings_record,
    stl_bytes,
    symmetry_record,
)
from dqreg.synth.coverage import visible_share
from dqreg.synth.noise import Noise
from dqreg.synth.parts.plain import Mesh
from dqreg.synth.raycast import centre_and_diagonal
from dqreg.synth.recipe import Recipe
from dqreg.synth.recipe_build import named
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
    is_tactile = isinstance(recipe.scanner, TactileProbe)
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
    }
    comments = [f"units {recipe.units}"]
    comments += ["time in sweeps; the motion is in truth.json"] if recipe.motion else []
    # The folder shall make itself again, also where the part came from a file that lies elsewhere.
    text = re.sub(r"(?m)^file\s*=.*$", f'file = "{PART}"', recipe.text)
    return {
        SCAN: ply_bytes(
            moved.points.astype(recipe.coordinates),
            comments,
            normals=moved.normals.astype(recipe.coordinates) if is_tactile else None,
            times=moved.times if recipe.motion else None,
        ),
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
        return scan_mesh(*part, recipe.scanner, recipe.noise, rng=rng, motion=recipe.motion, surroundings=surroundings)


def _keys(settings: Scene | Noise | AnyScanner) -> list[str]:
    return [field.name for field in dataclasses.fields(settings)]


def _seen(recipe: Recipe, part: Mesh, surroundings: Mesh | None) -> float | None:
    """Share of the surface that is seen; None for a probe, which sees nothing."""
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
