"""Real scans whose pose is known, as case folders for `dqreg compare`: scan.ply, part.stl or part.ply, truth.json.

The start is a drawn step away from the truth, the same for every engine: 5 degrees and 2 % of the smaller side.

    python examples/real_cases.py DATA cases/
    dqreg compare cases/* --timeout 60 --repeats 1 --report real.html
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import numpy as np
import trimesh
from real_pairs import Pair, real_pairs

import dqreg
from dqreg.files import write_cloud
from dqreg.rigid import pose
from dqreg.synth import disturbance

ANGLE_DEG, OFFSET = 5.0, 0.02
WANTED = (
    "weld tee, cropped",
    "bunny bun000 to mesh",
    "bunny bun090 to bun000",
    "Go-ICP bunny",
    "simpleICP dragon",
    "kitchen 1 to 0",
    "LiDAR on a car",
    "LiDAR, street",
)


def main(arguments: list[str] | None = None) -> list[Path]:
    """Folders written."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, help="folder of the data sets, see real_pairs.py")
    parser.add_argument("out", type=Path, help="folder for the cases")
    parser.add_argument("--all", action="store_true", help="every pair of the list, not the eight most different")
    options = parser.parse_args(arguments)
    pairs = (pair for pair in real_pairs(options.data) if options.all or pair.name in WANTED)
    return [write(pair, options.out / pair.name.replace(",", "").replace(" ", "_")) for pair in pairs]


def write(pair: Pair, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    write_cloud(folder / "scan.ply", pair.source)
    if isinstance(pair.target, dqreg.Mesh):
        corners = pair.target.vertices
        trimesh.Trimesh(corners, pair.target.faces, process=False).export(folder / "part.stl")
    else:
        corners = pair.target.points
        write_cloud(folder / "part.ply", corners)
    centre = 0.5 * (pair.judged.min(axis=0) + pair.judged.max(axis=0))
    step = disturbance(
        np.random.default_rng(0), np.deg2rad(ANGLE_DEG), OFFSET * pair.size, pose.apply(pair.T_truth, centre)
    )
    truth = {
        "T_target_source": pair.T_truth.tolist(),
        "T_start": (step @ pair.T_truth).tolist(),
        "units": "m",
        "part_diagonal": float(np.linalg.norm(np.ptp(corners, axis=0))),
        "range_sigma": 0.0,
        "seed": 0,
    }
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n", encoding="utf-8")
    return folder


if __name__ == "__main__":
    main()
