"""What the files of a case hold: recipe in, bytes out."""

from __future__ import annotations

import json
import re

import numpy as np

from dqreg.arrays import FloatArray
from dqreg.rigid import pose
from dqreg.synth.bound import cramer_rao_bound
from dqreg.synth.case_files import ply_bytes, stl_bytes
from dqreg.synth.coverage import visible_share
from dqreg.synth.raycast import centre_and_diagonal
from dqreg.synth.recipe import Recipe
from dqreg.synth.scanner import Scan, scan_mesh
from dqreg.synth.truth import disturbance, random_pose

SCAN, PART, TRUTH, RECIPE = "scan.ply", "part.stl", "truth.json", "recipe.toml"


def case_contents(recipe: Recipe) -> dict[str, bytes]:
    r"""Make the contents of a case's files.

    Parameters
    ----------
    recipe : Recipe
        What to make.

    Returns
    -------
    dict
        Bytes of ``scan.ply``, ``part.stl``, ``truth.json`` and ``recipe.toml``, by these names.

    Raises
    ------
    InputError
        If the part cannot be made or no ray brings a point back.
    DegenerateGeometryError
        If the views leave a direction of motion undetermined.

    Examples
    --------
    >>> from dqreg.synth.recipe import parse_recipe
    >>> text = 'seed = 1\n[part]\nkind = "box"\n[scanner]\npixels = 30\nviews = [[1, 2, 3]]\n'
    >>> sorted(case_contents(parse_recipe(text)))
    ['part.stl', 'recipe.toml', 'scan.ply', 'truth.json']
    """
    vertices, faces = recipe.mesh()
    centre, S = centre_and_diagonal(vertices)
    # One stream for the scan and one for the poses: more pixels do not change where the case starts.
    scan_rng, pose_rng = np.random.default_rng(recipe.seed).spawn(2)
    scan = scan_mesh(vertices, faces, recipe.scanner, recipe.noise, rng=scan_rng)
    seen = visible_share(vertices, faces, recipe.scanner, max_incidence_rad=recipe.noise.max_incidence_rad)
    T_source_target = random_pose(pose_rng, recipe.frame_offset * S, centre)
    T_target_source = pose.inverse(T_source_target)
    moved = scan.moved(T_source_target)
    step = disturbance(pose_rng, recipe.start_angle_rad, recipe.start_offset * S, centre)
    truth = {  # poses first: this is what a reader looks for
        "T_target_source": _rows(T_target_source),
        "T_start": _rows(step @ T_target_source),
        "units": recipe.units,
        "part_diagonal": S,
        "range_sigma": recipe.noise.range_sigma,
        "seed": recipe.seed,
        "name": recipe.name,
        "recipe": RECIPE,
        "start_angle_deg": float(np.rad2deg(recipe.start_angle_rad)),
        "start_offset": recipe.start_offset * S,
        "points": len(scan.points),
        "outliers": int(scan.is_outlier.sum()),
        "faces": len(faces),
        "surface_seen": round(seen, 3),
        "cramer_rao_rms": _bound(scan, vertices),
        "sensor_positions": _rows(moved.sensor_positions),
    }
    # The folder shall make itself again, also where the part came from a file that lies elsewhere.
    text = re.sub(r"(?m)^file\s*=.*$", f'file = "{PART}"', recipe.text)
    return {
        SCAN: ply_bytes(moved.points.astype(recipe.coordinates), f"units {recipe.units}"),
        PART: stl_bytes(vertices, faces),
        TRUTH: (json.dumps(truth, indent=2) + "\n").encode(),
        RECIPE: text.encode(),
    }


def _bound(scan: Scan, vertices: FloatArray) -> float:
    good = ~scan.is_outlier
    if not np.all(scan.range_sigma[good] > 0.0):
        return 0.0  # without noise the truth can be found exactly
    bound = cramer_rao_bound(
        scan.points[good], scan.ray_directions[good], scan.normals[good], scan.range_sigma[good], vertices
    )
    return float(f"{bound:.6g}")


def _rows(array: FloatArray) -> list[list[float]]:
    return [[float(x) for x in row] for row in array]
